"""Tables on the device of what can be drawn: pictures, annotated things, textured spots, tracks through clips."""

from __future__ import annotations

import math
import os
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain

import cv2
import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from tracker.train.compose import AERIAL, SEARCH_PX, TEMPLATE_PX, Composer, context_px
from tracker.train.gpu_atlas import TEXEL_BYTES, Atlas, build_atlas
from tracker.train.gpu_random import Dice
from tracker.train.pack import Imagery, Thing
from tracker.train.warp import outline_mask

HULL_POINTS = 64
SPRITE_PX = 160  # side of the window that holds any cut-out object
SHARPNESS = 1.4  # texels of an object per px of it in a patch
SPOTS_PER_PICTURE = 2


class TooLargeError(ValueError):
    """The pictures do not fit the memory they may take; the message says how much both are."""


@dataclass(frozen=True)
class Things:
    """Objects as tensors: annotated ones first, then the spots; px of their pictures, each (T,) or (T,...).

    hull (T,64,2), relative to the box's centre (T,2). corner (T,2): that centre in the sprite, in picture px.
    shrink (T,2): sprite px per picture px. covers: whether its picture fills most of a search patch.
    """

    picture: Tensor
    centre: Tensor
    size: Tensor
    context: Tensor
    hull: Tensor
    corner: Tensor
    shrink: Tensor
    covers: Tensor


@dataclass(frozen=True)
class Choices:
    """What is drawn how often. Tables of things, (.,) int64, with starts and counts of the groups in them."""

    annotated: int  # the first so many things; the rest are spots
    balance: Tensor  # cumulative probability of the annotated ones
    tracks: Tensor  # things, track after track
    track_start: Tensor
    track_count: Tensor
    track_reach: Tensor
    rivals: Tensor  # outlined things, label after label, then all of them once more
    rival_start: Tensor  # (T,) of the thing's own class, or of all
    rival_count: Tensor
    aerial: Tensor  # pictures

    def pairs(self, dice: Dice, size: int, clip_frac: float, spot_frac: float) -> tuple[Tensor, Tensor]:
        """Template's and search's things (size,): the same one unless a track through a clip is drawn."""
        thing = self.any_thing(dice, size)
        u = dice.uniform(0, 1, size)
        spot = self.annotated + dice.below(len(self.rival_start) - self.annotated, size)
        thing = torch.where(u < clip_frac + spot_frac, spot, thing) if spot_frac else thing
        if not len(self.track_start):
            return thing, thing
        track = dice.below(len(self.track_start), size)
        last, reach = self.track_count[track] - 1, self.track_reach[track]
        a = dice.below(last + 1, size)
        b = (a + dice.below(2 * reach + 1, size) - reach).clamp(min=0).minimum(last)
        first, second = (self.tracks[self.track_start[track] + i] for i in (a, b))
        clip = u < clip_frac
        return torch.where(clip, first, thing), torch.where(clip, second, thing)

    def any_thing(self, dice: Dice, size: int) -> Tensor:
        """Annotated things; spots where nothing is annotated."""
        if not self.annotated:
            return dice.below(len(self.rival_start), size)
        return dice.by_weight(self.balance, size)

    def spots(self, dice: Dice, size: int) -> Tensor:
        """Textured spots."""
        return self.annotated + dice.below(len(self.rival_start) - self.annotated, size)

    def other(self, dice: Dice, thing: Tensor) -> Tensor:
        """Another outlined object for each, of its class in most cases where there is one."""
        size, everything = len(thing), len(self.rivals) // 2
        if not everything:
            return self.spots(dice, size)
        same = dice.chance(0.6, size)
        start = torch.where(same, self.rival_start[thing], everything)
        count = torch.where(same, self.rival_count[thing], everything)
        return self.rivals[start + dice.below(count, size)]

    def grounds(self, dice: Dice, size: int, pictures: int) -> Tensor:
        """Pictures to paste on, views from above in most cases."""
        above = self.aerial[dice.below(len(self.aerial), size)]
        return torch.where(dice.chance(0.6, size), above, dice.below(pictures, size))


def tables(
    imagery: Imagery, device: torch.device, seed: int, limit_bytes: int | None = None
) -> tuple[Atlas, Things, Choices]:
    """Everything resident on the device; textures are the pictures' levels, then the things' sprites.

    Raises TooLargeError where the textures need more than limit_bytes, ValueError where there are no pictures.
    """
    if not len(imagery):
        raise ValueError("no pictures to compose from")
    if not imagery.in_memory:
        raise TooLargeError(f"{len(imagery)} pictures are read from the disc: worker processes must compose them")
    cv2.setNumThreads(1)
    things = [*imagery.things, *_spots(imagery, np.random.default_rng(seed))]
    places = [_Place.of(imagery, t) for t in things]
    sizes = [p.shape[:2] for pyramid in imagery.pyramids for p in pyramid] + [p.sprite_size for p in places]
    needed = sum(h * w for h, w in sizes) * TEXEL_BYTES
    if limit_bytes is not None and needed > limit_bytes:
        raise TooLargeError(f"the pictures need {needed / 1e9:.1f} GB, {limit_bytes / 1e9:.1f} GB may be taken")
    hulls = np.zeros((len(things), HULL_POINTS, 2), np.float32)
    with tqdm(total=len(sizes), desc="pictures to the device", unit="", disable=len(sizes) < 5000) as bar:
        pictures = chain.from_iterable(imagery.pyramids)
        atlas = build_atlas(sizes, chain(pictures, _sprites(imagery, things, places, hulls)), device, bar.update)
    on_device = [torch.from_numpy(a).to(device) for a in _columns(imagery, things, places, hulls)]
    return atlas, Things(*on_device), _choices(imagery, things, device)


@dataclass(frozen=True)
class _Place:
    """The rectangle of a picture that holds a thing, px, and how much its sprite shrinks it."""

    x0: int
    y0: int
    w: int
    h: int
    shrink: float

    @classmethod
    def of(cls, imagery: Imagery, thing: Thing) -> _Place:
        height, width = imagery.pyramids[thing.image][0].shape[:2]
        x, y, w, h = thing.box
        x0, y0 = max(0, int(x) - 2), max(0, int(y) - 2)
        x1, y1 = min(width, math.ceil(x + w) + 2), min(height, math.ceil(y + h) + 2)
        scale = SHARPNESS * TEMPLATE_PX / context_px(w, h)
        shrink = min(1.0, scale, (SPRITE_PX - 2) / max(x1 - x0, y1 - y0))
        return cls(x0, y0, x1 - x0, y1 - y0, shrink)

    @property
    def sprite_size(self) -> tuple[int, int]:
        """Height and width of the sprite."""
        return max(1, round(self.h * self.shrink)), max(1, round(self.w * self.shrink))


def _sprites(imagery: Imagery, things: list[Thing], places: list[_Place], hulls: np.ndarray) -> Iterator[np.ndarray]:
    """The things cut out with soft edges, (h,w,4); fills in the hulls on the way."""

    def sprite(i: int) -> np.ndarray:
        thing, at = things[i], places[i]
        x, y, w, h = thing.box
        alpha, points = outline_mask(imagery, thing, at.x0, at.y0, at.w, at.h)
        hulls[i] = hull_points(points - [x + w / 2 - at.x0, y + h / 2 - at.y0])
        crop = imagery.pyramids[thing.image][0][at.y0 : at.y0 + at.h, at.x0 : at.x0 + at.w]
        if at.shrink < 1:
            height, width = at.sprite_size
            crop = cv2.resize(crop, (width, height), interpolation=cv2.INTER_AREA)
            alpha = cv2.resize(alpha, (width, height), interpolation=cv2.INTER_AREA)
        return np.dstack([crop, cv2.blur(alpha, (3, 3))])

    with ThreadPoolExecutor(min(8, os.cpu_count() or 1)) as pool:
        for start in range(0, len(things), 512):
            yield from pool.map(sprite, range(start, min(start + 512, len(things))))


def hull_points(points: np.ndarray, count: int = HULL_POINTS) -> np.ndarray:
    """Exactly count points (count,2) on the convex hull of points (N,2), its corners among them.

    Of a hull with more corners than that, the outermost in as many directions.
    """
    corners = cv2.convexHull(np.ascontiguousarray(points, np.float32))[:, 0]
    if len(corners) >= count:
        direction = np.linspace(0, 2 * np.pi, count, endpoint=False)
        outward = np.stack([np.cos(direction), np.sin(direction)])
        return corners[(corners @ outward).argmax(0)]
    edge = np.linalg.norm(np.roll(corners, -1, 0) - corners, axis=1)
    extra = (count - len(corners)) * edge / max(edge.sum(), 1e-6)
    parts = 1 + np.floor(np.cumsum(extra) + 1e-6).astype(int) - np.floor(np.cumsum(extra) - extra + 1e-6).astype(int)
    parts[-1] += count - parts.sum()
    ends = np.roll(corners, -1, 0)
    return np.concatenate(
        [a + (b - a) * (np.arange(n) / n)[:, None] for a, b, n in zip(corners, ends, parts, strict=True)]
    )


def _spots(imagery: Imagery, rng: np.random.Generator) -> Iterator[Thing]:
    """Textured rectangles of every picture, as objects without outline."""
    composer = Composer(imagery, int(rng.integers(2**31)))
    for picture in range(len(imagery)):
        for _ in range(SPOTS_PER_PICTURE):
            yield composer._spot(picture)


def _columns(imagery: Imagery, things: list[Thing], places: list[_Place], hulls: np.ndarray) -> Iterator[np.ndarray]:
    box = np.array([t.box for t in things], np.float32)
    centre = box[:, :2] + box[:, 2:] / 2
    context = np.array([context_px(*t.box[2:]) for t in things], np.float32)
    picture = np.array([t.image for t in things], np.int64)
    short = np.array([min(p[0].shape[:2]) for p in imagery.pyramids])
    yield from (picture, centre, box[:, 2:], context, hulls)
    yield centre - np.array([(p.x0, p.y0) for p in places], np.float32)
    yield np.array([(p.sprite_size[1] / p.w, p.sprite_size[0] / p.h) for p in places], np.float32)
    yield short[picture] * TEMPLATE_PX / context > 0.85 * SEARCH_PX


def _choices(imagery: Imagery, things: list[Thing], device: torch.device) -> Choices:
    annotated = len(imagery.things)
    by_label: dict[str, list[int]] = defaultdict(list)
    for i in imagery.outlined():
        by_label[things[i].label].append(i)
    everyone = [i for group in by_label.values() for i in group]
    start, group = {}, 0
    for label, members in by_label.items():
        start[label], group = group, group + len(members)
    whole = (len(everyone), len(everyone))
    rival = [(start[t.label], len(by_label[t.label])) if t.label in start else whole for t in things]
    count = [len(t) for t in imagery.tracks]
    aerial = [i for i, part in enumerate(imagery.parts) if part in AERIAL] or list(range(len(imagery)))

    def whole_numbers(values: object) -> Tensor:
        return torch.from_numpy(np.array(values, np.int64)).to(device)

    return Choices(
        annotated,
        torch.from_numpy(_balance(imagery) if annotated else np.ones(1)).to(device),
        whole_numbers([i for track in imagery.tracks for i in track]),
        whole_numbers(np.cumsum([0, *count])[:-1]),
        whole_numbers(count),
        whole_numbers([imagery.reach(i) for i in range(len(imagery.tracks))]),
        whole_numbers(everyone + everyone),
        whole_numbers([r[0] for r in rival]),
        whole_numbers([r[1] for r in rival]),
        whole_numbers(aerial),
    )


def _balance(imagery: Imagery) -> np.ndarray:
    """Cumulative probability of each thing: the square root of its part's count shared by the part."""
    return Composer(imagery, 0)._balanced

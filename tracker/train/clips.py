"""What held-out clips offer to be examined on: tracks to follow, pairs to find again, adjacent triplets."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar, overload

import cv2
import numpy as np

from tracker.box import Box
from tracker.configs import TrackerConfig
from tracker.crop import Colour, context_side_px, crop, mean_colour
from tracker.train.pack import Imagery

# Clips of these parts were sampled seconds apart: nothing lies half-way between two of their frames.
SLOW_PARTS = frozenset({"korban", "farmclips", "manaus", "atl", "wagon"})
PAIR_OFFSET_PX = 64.0  # of the search patch: how far off its centre the target lies at most
GAP_TOLERANCE = 0.4  # of the wanted gap: packs keep bursts of frames, not every one

T = TypeVar("T")
Triplet = tuple[np.ndarray, np.ndarray, np.ndarray]  # previous, middle and current patch


class Pictures(Sequence[np.ndarray]):
    """Full-size pictures of an Imagery by index, read when asked for."""

    def __init__(self, imagery: Imagery, indices: Sequence[int]) -> None:
        self._imagery, self._indices = imagery, list(indices)

    def __len__(self) -> int:
        return len(self._indices)

    @overload
    def __getitem__(self, at: int) -> np.ndarray: ...
    @overload
    def __getitem__(self, at: slice) -> Pictures: ...
    def __getitem__(self, at: int | slice) -> np.ndarray | Pictures:
        if isinstance(at, slice):
            return Pictures(self._imagery, self._indices[at])
        return self._imagery.pyramids[self._indices[at]][0]


@dataclass(frozen=True, slots=True)
class TruthClip:
    """Frames (H,W,3) uint8 BGR and the target's box in each: (N,4) x,y,w,h px, NaN where it is not to be seen."""

    name: str
    images: Sequence[np.ndarray]
    truth_xywh: np.ndarray

    def __len__(self) -> int:
        return len(self.images)


@dataclass(frozen=True, slots=True)
class Pair:
    """A template and a later search patch (S,S,3) uint8 BGR; where in it the target's centre lies, px."""

    template: np.ndarray
    search: np.ndarray
    centre_px: tuple[float, float]


def spread(items: Sequence[T], most: int) -> list[T]:
    """At most `most` of the items, evenly spaced."""
    if len(items) <= most:
        return list(items)
    return [items[i] for i in np.linspace(0, len(items) - 1, most).round().astype(int)]


def tracked_clips(imagery: Imagery, most: int = 20, longest: int = 40, shortest: int = 6) -> list[TruthClip]:
    """Tracks through clips that are long enough to be followed, each cut to its first `longest` frames."""
    long_enough = [track for track in imagery.tracks if len(track) >= shortest]
    return [_truth_clip(imagery, track[:longest]) for track in spread(long_enough, most)]


def _truth_clip(imagery: Imagery, track: Sequence[int]) -> TruthClip:
    things = [imagery.things[i] for i in track]
    name = f"{imagery.parts[things[0].image]}:{things[0].image}:{track[0]}"
    return TruthClip(name, Pictures(imagery, [t.image for t in things]), np.array([t.box for t in things], float))


def relocalisation_pairs(
    imagery: Imagery, gap: int, seed: int, most: int = 96, config: TrackerConfig | None = None
) -> list[Pair]:
    """Templates and search patches about `gap` frames later, the target off the centre by up to 64 px.

    Where no frame lies that far ahead the nearest one does, within 40 %. The same pairs for the same seed.
    What lies outside a frame shows another part's picture: beside one flat colour the frame is an island whose
    place gives the target's away, and an untrained backbone is right three times in four.
    """
    config = config or TrackerConfig()
    candidates = [pair for track in spread(imagery.tracks, 200) for pair in _partners(imagery, track, gap)]
    rng = np.random.default_rng((seed, gap))
    pairs = []
    for first, later in spread(candidates, most):
        offset = rng.uniform(-PAIR_OFFSET_PX, PAIR_OFFSET_PX, 2)
        pairs.append(_pair(imagery, first, later, offset, _scenery(imagery, later, rng), config))
    return pairs


def _partners(imagery: Imagery, track: Sequence[int], gap: int) -> Iterator[tuple[int, int]]:
    """Each thing of the track with the later one whose frame is nearest to `gap` ahead."""
    frames = np.array([imagery.frames[imagery.things[i].image] for i in track])
    for i, frame in enumerate(frames[:-1]):
        later = i + 1 + int(np.abs(frames[i + 1 :] - frame - gap).argmin())
        if abs(frames[later] - frame - gap) <= GAP_TOLERANCE * gap:
            yield track[i], track[later]


def _scenery(imagery: Imagery, thing: int, rng: np.random.Generator) -> np.ndarray:
    """A picture of another part, so that it does not show the same target again (of any part, if there is but one)."""
    own = imagery.parts[imagery.things[thing].image]
    drawn = [int(i) for i in rng.integers(len(imagery), size=16)]
    others = [i for i in drawn if imagery.parts[i] != own]
    return imagery.pyramids[(others or drawn)[0]][0]


def _pair(
    imagery: Imagery, first: int, later: int, offset_px: np.ndarray, scenery: np.ndarray, config: TrackerConfig
) -> Pair:
    a, b = imagery.things[first], imagery.things[later]
    template = patch_of(imagery.pyramids[a.image][0], Box.from_xywh(*a.box), config.exemplar_px, config)
    box = Box.from_xywh(*b.box)
    scale = context_side_px(box.w_px, box.h_px, config.context_frac) / config.exemplar_px  # frame px per patch px
    away = Box(box.cx_px + offset_px[0] * scale, box.cy_px + offset_px[1] * scale, box.w_px, box.h_px)
    frame = imagery.pyramids[b.image][0]
    search = patch_of(frame, away, config.search_px, config)
    is_frame = patch_of(np.full_like(frame, 255), away, config.search_px, config, fill=(0, 0, 0)) > 127
    search = np.where(is_frame, search, _middle_square(scenery, config.search_px))
    middle = (config.search_px - 1) / 2
    return Pair(template, search, (middle - float(offset_px[0]), middle - float(offset_px[1])))


def patch_of(
    frame_bgr: np.ndarray, box: Box, out_px: int, config: TrackerConfig, fill: Colour | None = None
) -> np.ndarray:
    """The patch round the box as the tracker cuts it: context to 127 px, so 2.26 of it to 287 px."""
    side = context_side_px(box.w_px, box.h_px, config.context_frac) * out_px / config.exemplar_px
    return crop(frame_bgr, box.cx_px, box.cy_px, max(1, round(side)), out_px, fill or mean_colour(frame_bgr))


def adjacent_triplets(imagery: Imagery, most: int = 32, size_px: int = 287) -> list[Triplet]:
    """Three frames in a row of clips at video rate: their middle squares as patches (size,size,3) uint8 BGR."""
    found = []
    for clip in imagery.clips:
        if imagery.parts[clip[0]] in SLOW_PARTS:
            continue
        for trio in zip(clip, clip[1:], clip[2:], strict=False):
            a, b, c = (imagery.frames[i] for i in trio)
            if (b - a, c - b) == (1, 1):
                found.append(trio)
    return [_triplet(imagery, trio, size_px) for trio in spread(found, most)]


def _triplet(imagery: Imagery, trio: tuple[int, int, int], size_px: int) -> Triplet:
    a, b, c = (_middle_square(imagery.pyramids[i][0], size_px) for i in trio)
    return a, b, c


def _middle_square(frame_bgr: np.ndarray, size_px: int) -> np.ndarray:
    h, w = frame_bgr.shape[:2]
    side = min(h, w)
    x, y = (w - side) // 2, (h - side) // 2
    shrinks = side > size_px
    square = frame_bgr[y : y + side, x : x + side]
    return cv2.resize(square, (size_px, size_px), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)

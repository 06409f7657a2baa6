"""One training sample: a template and the frames of a synthetic moment, with the target's exact box.

The search patch is the tracker's own: 287 px wide, centred near where the target was, scaled so that the
target with its context fills 127 px. Objects come from annotated things (cut out and pasted on another
background, or left on their own), from clips, or are any textured spot of any picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tracker.train import photometric
from tracker.train.pack import Imagery, Thing, unbroken
from tracker.train.warp import CutOut, Pose, context_px, cut_out, paste, thing_centre, warp_around

SEARCH_PX, TEMPLATE_PX = 287, 127
AERIAL = ("hrplanes", "atl", "aerial_cars", "korban", "porong", "brighton_drone", "odcam", "manaus")


@dataclass(frozen=True)
class Recipe:
    """Shares and strengths of everything random; the names are those of the training configuration."""

    own_background_frac: float = 0.4
    clip_frac: float = 0.15
    spot_frac: float = 0.15  # any textured spot as the object
    negative_frac: float = 0.05
    template_moved_frac: float = 0.4  # template re-pasted on another background
    any_rotation_frac: float = 0.35
    rotation_std_rad: float = 0.16
    scale_std: float = 0.14
    aspect_std: float = 0.07
    shift_px: float = 64.0
    distractor_frac: float = 0.5
    occluder_frac: float = 0.2
    shadow_frac: float = 0.35  # of targets pasted on another background
    deformed_frac: float = 0.15  # of targets pasted on another background; composed on a GPU only
    coarse_frac: float = 0.45


@dataclass(frozen=True)
class Sample:
    """template (127,127,3), previous, middle and search (287,287,3) uint8 BGR; box x1,y1,x2,y2 in search px.

    positive is False where the template's object is not in the search patch. middle is the true frame
    half-way between previous and search.
    """

    template: np.ndarray
    previous: np.ndarray
    middle: np.ndarray | None
    search: np.ndarray
    box: tuple[float, float, float, float]
    positive: bool


class Composer:
    """Draws samples from an Imagery. One per worker; deterministic for its seed."""

    def __init__(self, imagery: Imagery, seed: int, recipe: Recipe | None = None, middle: bool = False) -> None:
        self.imagery = imagery
        self.recipe = recipe or Recipe()
        self.rng = np.random.default_rng(seed)
        self.noise = photometric.Noise(self.rng)
        self.middle = middle
        self._outlined = imagery.outlined()
        self._by_label: dict[str, list[int]] = {}
        for i in self._outlined:
            self._by_label.setdefault(imagery.label(i), []).append(i)
        self._balanced = self._balance()
        self._aerial = [i for i, p in enumerate(imagery.parts) if p in AERIAL] or range(len(imagery))

    def _balance(self) -> np.ndarray:
        """Probability of each thing: the square root of its part's count shared by the part."""
        names, inverse, counts = self.imagery.part_counts()
        weight = np.sqrt(counts) * np.array([2.0 if n in AERIAL else 1.0 for n in names])
        p = (weight / counts)[inverse]
        return np.cumsum(p / p.sum())

    # -- choosing -------------------------------------------------------------------------------------

    def _thing(self) -> Thing:
        if not len(self._balanced):  # clips without boxes
            return self._spot()
        i = int(np.searchsorted(self._balanced, self.rng.random()))
        return self.imagery.things[min(i, len(self.imagery.things) - 1)]

    def _spot(self, image: int | None = None) -> Thing:
        """A textured rectangle of any picture, as an object without outline."""
        rng = self.rng
        image = int(rng.integers(len(self.imagery))) if image is None else image
        h, w = self.imagery.pyramids[image][0].shape[:2]
        best, best_std = None, -1.0
        for _ in range(3):
            bw = rng.uniform(14, min(90, w / 2))
            bh = np.clip(bw * np.exp(rng.normal(0, 0.4)), 12, h / 2)
            x, y = rng.uniform(0, w - bw), rng.uniform(0, h - bh)
            std = float(self.imagery.pyramids[image][0][int(y) : int(y + bh), int(x) : int(x + bw)].std())
            if std > best_std:
                best, best_std = (x, y, bw, bh), std
        return Thing(image, best)

    def _pair(self) -> tuple[Thing, Thing]:
        """Template's and search's source; the same thing unless a track through a clip is drawn."""
        u = self.rng.random()
        if u < self.recipe.clip_frac and self.imagery.tracks:
            chosen = int(self.rng.integers(len(self.imagery.tracks)))
            track, reach = self.imagery.tracks[chosen], self.imagery.reach(chosen)
            a = int(self.rng.integers(len(track)))
            b = int(np.clip(a + self.rng.integers(-reach, reach + 1), 0, len(track) - 1))
            return self.imagery.things[track[a]], self.imagery.things[track[b]]
        if u < self.recipe.clip_frac + self.recipe.spot_frac:
            thing = self._spot()
            return thing, thing
        thing = self._thing()
        return thing, thing

    def _background(self) -> int:
        if self.rng.random() < 0.6:
            return self._aerial[self.rng.integers(len(self._aerial))]
        return int(self.rng.integers(len(self.imagery)))

    # -- rendering ------------------------------------------------------------------------------------

    def _pose(self, thing: Thing, size_px: int, base: Pose, shift_px: tuple[float, float], wide: float) -> Pose:
        """Where the thing lies in a patch: its 127 px context scaled, jittered by `wide`."""
        rng, r = self.rng, self.recipe
        scale = TEMPLATE_PX / context_px(thing.box[2], thing.box[3]) * math.exp(rng.normal(0, r.scale_std * wide))
        aspect = math.exp(rng.normal(0, r.aspect_std * wide))
        turn = base.angle_rad + rng.normal(0, r.rotation_std_rad * wide)
        c = (size_px - 1) / 2
        return Pose(
            c + shift_px[0],
            c + shift_px[1],
            scale * aspect,
            scale / aspect,
            turn,
            rng.normal(0, 0.06 * wide),
            base.flip,
        )

    def _covers(self, thing: Thing) -> bool:
        """Whether the thing's own picture fills most of a search patch."""
        h, w = self.imagery.pyramids[thing.image][0].shape[:2]
        return min(w, h) * TEMPLATE_PX / context_px(thing.box[2], thing.box[3]) > 0.85 * SEARCH_PX

    def _ground(self, image: int, size_px: int) -> tuple[int, Pose]:
        """A picture and a pose that makes it fill the patch with some room to pan."""
        h, w = self.imagery.pyramids[image][0].shape[:2]
        rng = self.rng
        scale = size_px * 1.25 / min(w, h) * math.exp(rng.uniform(0, 1.2))
        room_x, room_y = max(0.0, w - 1.2 * size_px / scale) / 2, max(0.0, h - 1.2 * size_px / scale) / 2
        cx, cy = w / 2 + rng.uniform(-room_x, room_x), h / 2 + rng.uniform(-room_y, room_y)
        angle = rng.uniform(-math.pi, math.pi) if rng.random() < 0.3 else rng.normal(0, 0.1)
        pose = Pose((size_px - 1) / 2, (size_px - 1) / 2, scale, scale, angle, 0.0, bool(rng.random() < 0.5))
        return image, pose.about(cx, cy)

    def sample(self) -> Sample:
        """Draw one sample."""
        return unbroken(self._draw)

    def _draw(self) -> Sample:
        rng, r = self.rng, self.recipe
        z_thing, x_thing = self._pair()
        own = rng.random() < r.own_background_frac and self._covers(x_thing)
        positive = rng.random() >= r.negative_frac
        angle = rng.uniform(-math.pi, math.pi) if rng.random() < r.any_rotation_frac else rng.normal(0, 0.1)
        base = Pose(0, 0, 1, 1, angle, 0.0, bool(rng.random() < 0.5))
        template = self._template(z_thing, base, moved=not own and rng.random() < r.template_moved_frac)
        frames, box = self._frames(x_thing if positive else self._thing(), base, own)
        frames = self._look([template, *frames])
        previous, middle, search = (frames[1], None, frames[2]) if len(frames) == 3 else frames[1:4]
        return Sample(frames[0], previous, middle, search, box, positive)

    def _template(self, thing: Thing, base: Pose, moved: bool) -> np.ndarray:
        jitter = self.rng.normal(0, 2.5, 2)
        pose = self._pose(thing, TEMPLATE_PX, base, (jitter[0], jitter[1]), 0.4)
        pyramid = self.imagery.pyramids[thing.image]
        if not moved:
            return warp_around(pyramid, pose.about(*thing_centre(thing)), TEMPLATE_PX)
        image, ground = self._ground(self._background(), TEMPLATE_PX)
        patch = warp_around(self.imagery.pyramids[image], ground, TEMPLATE_PX)
        paste(patch, cut_out(self.imagery, thing), pose)
        return patch

    def _frames(
        self, thing: Thing, base: Pose, own: bool
    ) -> tuple[list[np.ndarray], tuple[float, float, float, float]]:
        """previous, (middle,) search; and the target's box in search."""
        rng, r = self.rng, self.recipe
        if rng.random() < 0.7:
            shift = tuple(rng.uniform(-r.shift_px, r.shift_px, 2))
        else:
            shift = tuple(rng.normal(0, 14, 2))
        now = self._pose(thing, SEARCH_PX, base, shift, 1.0)
        motion = rng.normal(0, 9, 2) + np.asarray(shift) * rng.uniform(0, 1)
        before = now.moved(-motion[0], -motion[1], math.exp(rng.normal(0, 0.03)), rng.normal(0, 0.05))
        cutter = cut_out(self.imagery, thing)
        ground = None if own else self._ground(self._background(), SEARCH_PX)
        pan = rng.normal(0, 6, 2)
        extras = self._extras(thing, now, cutter)
        if ground is not None and rng.random() < r.shadow_frac:
            extras.append(self._shadow(now, cutter))
        frames = []
        for t in (0.0, 0.5, 1.0) if self.middle else (0.0, 1.0):
            pose = before.towards(now, t)
            if ground is None:
                patch = warp_around(self.imagery.pyramids[thing.image], pose.about(*thing_centre(thing)), SEARCH_PX)
            else:
                back = (1 - t) * pan
                patch = warp_around(self.imagery.pyramids[ground[0]], ground[1].moved(back[0], back[1]), SEARCH_PX)
            for other, where, above in extras:
                if not above:
                    paste(patch, other, where)
            if ground is not None:
                paste(patch, cutter, pose)
            for other, where, above in extras:
                if above:
                    paste(patch, other, where)
            frames.append(patch)
        return frames, now.box_of(cutter)

    def _extras(self, thing: Thing, now: Pose, cutter: CutOut) -> list[tuple[CutOut, Pose, bool]]:
        """Distractors (under the target) and an occluder (over part of it)."""
        rng, r, extras = self.rng, self.recipe, []
        if rng.random() < r.distractor_frac:
            for _ in range(int(rng.integers(1, 4))):
                other = cutter.recoloured(rng) if rng.random() < 0.5 else self._rival(thing)
                away = rng.uniform(0, 2 * math.pi)
                far = rng.uniform(45, 170)
                x, y = now.x + far * math.cos(away), now.y + far * math.sin(away)
                size = TEMPLATE_PX / context_px(other.w, other.h) * math.exp(rng.normal(0, 0.25))
                extras.append((other, Pose(x, y, size, size, rng.uniform(-math.pi, math.pi), 0.0, False), False))
        if rng.random() < r.occluder_frac:
            spot = cut_out(self.imagery, self._spot())
            x1, y1, x2, y2 = now.box_of(cutter)
            size = rng.uniform(0.3, 0.75) * max(x2 - x1, y2 - y1)
            away = rng.uniform(0, 2 * math.pi)
            x = (x1 + x2) / 2 + 0.5 * (x2 - x1) * math.cos(away)
            y = (y1 + y2) / 2 + 0.5 * (y2 - y1) * math.sin(away)
            extras.append((spot, Pose(x, y, size / spot.w, size / spot.h, 0.0, 0.0, False), True))
        return extras

    def _shadow(self, now: Pose, cutter: CutOut) -> tuple[CutOut, Pose, bool]:
        """The target's own shadow beside it: dark, shaped alike, moving along, and not the target."""
        rng = self.rng
        x1, y1, x2, y2 = now.box_of(cutter)
        away = rng.uniform(0, 2 * math.pi)
        reach = rng.uniform(0.7, 1.05)
        turned = now.moved(
            reach * (x2 - x1) * math.cos(away), reach * (y2 - y1) * math.sin(away), rng.uniform(0.7, 1.2), math.pi
        )
        return cutter.shadow(rng), turned, False

    def _rival(self, thing: Thing) -> CutOut:
        """Another outlined object, of the same class where there is one."""
        same = self._by_label.get(thing.label) or self._outlined
        pool = same if self.rng.random() < 0.6 else self._outlined
        if not pool:
            return cut_out(self.imagery, self._spot())
        return cut_out(self.imagery, self.imagery.things[pool[self.rng.integers(len(pool))]])

    def _look(self, patches: list[np.ndarray]) -> list[np.ndarray]:
        """Light, sensor and codec: the template by itself, the frames of the moment together."""
        rng, r = self.rng, self.recipe
        colourless = rng.random() < 0.12
        coarse = rng.uniform(0.22, 0.8) if rng.random() < r.coarse_frac else 1.0
        blur = (int(rng.integers(3, 10)), rng.uniform(0, math.pi)) if rng.random() < 0.2 else None
        quality = int(rng.integers(15, 70)) if rng.random() < 0.2 else None
        fog = rng.uniform(0.05, 0.4) if rng.random() < 0.1 else 0.0
        out = []
        state = rng.integers(2**32)
        for i, patch in enumerate(patches):
            own = np.random.default_rng(state if i else state + 1)  # the moment shares one light
            factor = float(np.clip(coarse * np.exp(rng.normal(0, 0.15)), 0.2, 1.0)) if coarse < 1 and i == 0 else coarse
            if factor < 0.95:
                patch = photometric.coarsen(patch, factor)
            patch = photometric.tone(patch, own)
            if colourless:
                patch = photometric.grey(patch)
            if i and fog:
                patch = photometric.haze(patch, fog)
            if i and blur:
                patch = photometric.motion_blur(patch, *blur)
            if rng.random() < 0.4:
                patch = self.noise.add(patch, rng.uniform(1, 9), rng)
            if quality is not None and (i or rng.random() < 0.5):
                patch = photometric.compress(patch, quality)
            out.append(patch)
        return out

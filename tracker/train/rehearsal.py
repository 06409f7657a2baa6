"""Clips to rehearse losing and finding on: held-out pictures set in motion, targets that go behind things."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from tqdm import tqdm

from tracker.box import Box, TrackResult
from tracker.eval.ope import overlaps
from tracker.online import ClimRTTracker
from tracker.train import photometric
from tracker.train.clips import TruthClip
from tracker.train.pack import Imagery, Thing
from tracker.train.reliability import GOOD_IOU
from tracker.train.warp import CutOut, Pose, cut_out, paste, warp_around

HIDDEN_FRAC = 0.85  # of the box covered, or out of the picture: from here on nobody can see the target
COVER = 1.35  # an occluder's side over the target's
FRAME_PX = 352
COMPOSED = "composed"  # how the names of composed clips begin


@dataclass(frozen=True, slots=True)
class Observations:
    """One row per tracked frame: features (N,K), whether IoU > 0.5 (N,), and the clip (N,) it comes from."""

    features: np.ndarray
    good: np.ndarray
    groups: np.ndarray


def observe(
    tracker: ClimRTTracker, clips: Iterable[TruthClip], features_of: Callable[[TrackResult], Sequence[float]]
) -> Observations:
    """Track every clip from its first frame and keep what the tracker said and whether it was right.

    A box while the target is not to be seen is never right. Two clips of one name are one group.
    """
    features, good, groups = [], [], []
    for clip in tqdm(clips, desc="observing", unit=" clips", leave=False, disable=None):
        tracker.init(clip.images[0], Box.from_xywh(*clip.truth_xywh[0]))
        for i in range(1, len(clip)):
            result = tracker.update(clip.images[i])
            features.append(tuple(features_of(result)))
            iou = overlaps(np.array([result.box.xywh]), clip.truth_xywh[i : i + 1])[0]
            good.append(bool(iou > GOOD_IOU))
            groups.append(clip.name)
    return Observations(np.array(features, float), np.array(good, bool), np.array(groups))


def hidden_for_a_while(clip: TruthClip, scenery: np.ndarray, rng: np.random.Generator) -> TruthClip:
    """The clip with its target behind a piece of another picture for a fifth to a half of its frames."""
    count = len(clip)
    length = int(rng.integers(max(1, count // 5), max(2, count // 2)))
    start = int(rng.integers(2, max(3, count - length)))
    truth, images = np.array(clip.truth_xywh, float), [np.asarray(image) for image in clip.images]
    for i in range(start, min(start + length, count)):
        images[i] = _covered(images[i], truth[i], scenery)
        truth[i] = np.nan
    return TruthClip(clip.name, images, truth)


def _covered(image: np.ndarray, box: np.ndarray, scenery: np.ndarray) -> np.ndarray:
    out, (x, y, w, h) = image.copy(), box
    x0, x1 = (round(x + w / 2 + side * COVER * w / 2) for side in (-1, 1))
    y0, y1 = (round(y + h / 2 + side * COVER * h / 2) for side in (-1, 1))
    x0, x1, y0, y1 = max(0, x0), min(out.shape[1], x1), max(0, y0), min(out.shape[0], y1)
    if x1 > x0 and y1 > y0:
        out[y0:y1, x0:x1] = cv2.resize(scenery, (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA)
    return out


def composed_clip(imagery: Imagery, seed: int, frames: int = 40) -> TruthClip:
    """An outlined object on its way over a still, with rivals, mostly with something it goes behind.

    Frames are FRAME_PX squares; the camera drifts, zooms, and its pictures are noisy. Raises ValueError for
    imagery without things.
    """
    if not imagery.things:
        raise ValueError("no objects to compose a clip of")
    rng = np.random.default_rng(seed)
    outlined = imagery.outlined() or list(range(len(imagery.things)))
    target, *rivals = (imagery.things[outlined[i]] for i in rng.integers(len(outlined), size=1 + rng.integers(0, 4)))
    ground = int(rng.integers(len(imagery)))
    camera = _walk(rng, frames, 1.5)
    zoom = np.exp(np.cumsum(rng.normal(0, 0.004, frames)))
    size_px = math.exp(rng.uniform(math.log(18), math.log(90)))
    way = _Way.drawn(imagery, target, rng, frames, size_px)
    others = [_Way.drawn(imagery, thing, rng, frames, size_px * math.exp(rng.normal(0, 0.3))) for thing in rivals]
    cover = _passing(imagery, way, rng, frames, size_px) if rng.random() < 0.7 else None
    noise, strength = photometric.Noise(rng), rng.uniform(1, 6)
    images, truth = [], []
    for i in range(frames):
        image = warp_around(imagery.pyramids[ground], _ground_pose(imagery, ground, camera[i], zoom[i]), FRAME_PX)
        for other in others:
            paste(image, other.cutter, other.pose(i, camera[i], zoom[i]))
        paste(image, way.cutter, way.pose(i, camera[i], zoom[i]))
        box = way.pose(i, camera[i], zoom[i]).box_of(way.cutter)
        hider = None
        if cover is not None:
            pose = cover.pose(i, camera[i], zoom[i])
            paste(image, cover.cutter, pose)
            hider = pose.box_of(cover.cutter)
        images.append(noise.add(image, strength, rng))
        truth.append(_seen_box(box, hider))
    return TruthClip(f"{COMPOSED}:{seed}", images, np.array(truth))


@dataclass(frozen=True, slots=True)
class _Way:
    """A cut-out's path: places (N,2) frame px before the camera moves, scales (N,), turns (N,) rad."""

    cutter: CutOut
    places: np.ndarray
    scales: np.ndarray
    turns: np.ndarray

    @classmethod
    def drawn(cls, imagery: Imagery, thing: Thing, rng: np.random.Generator, frames: int, size_px: float) -> _Way:
        cutter = cut_out(imagery, thing)
        places = rng.uniform(0.3, 0.7, 2) * FRAME_PX + _walk(rng, frames, 2.0)
        scales = size_px / max(cutter.w, cutter.h) * np.exp(np.cumsum(rng.normal(0, 0.01, frames)))
        return cls(cutter, places, scales, np.cumsum(rng.normal(0, 0.02, frames)))

    def pose(self, i: int, camera: np.ndarray, zoom: float) -> Pose:
        """Where it lies in frame i."""
        x, y = (self.places[i] - FRAME_PX / 2) * zoom + FRAME_PX / 2 + camera
        scale = float(self.scales[i] * zoom)
        return Pose(float(x), float(y), scale, scale, float(self.turns[i]), 0.0, False)


def _passing(imagery: Imagery, way: _Way, rng: np.random.Generator, frames: int, size_px: float) -> _Way:
    """A piece of any picture that crosses the target's way, wholly over it for some frames."""
    image = int(rng.integers(len(imagery)))
    h, w = imagery.pyramids[image][0].shape[:2]
    side = min(w, h) * rng.uniform(0.3, 0.6)
    x, y = rng.uniform(0, w - side), rng.uniform(0, h - side)
    cutter = cut_out(imagery, Thing(image, (float(x), float(y), float(side), float(side))))
    wide_px = size_px * rng.uniform(1.6, 2.6)
    meeting = rng.uniform(0.25, 0.75) * frames
    # px a frame, relative to the target; never so slow that it hides the target in the first frame
    speed = max(wide_px / rng.uniform(6, 16), 1.5 * wide_px / meeting)
    away = rng.uniform(0, 2 * math.pi)
    steps = (np.arange(frames) - meeting)[:, None] * speed * np.array([math.cos(away), math.sin(away)])
    return _Way(cutter, way.places + steps, np.full(frames, wide_px / side), np.zeros(frames))


def _walk(rng: np.random.Generator, frames: int, speed_px: float) -> np.ndarray:
    """A smooth path (N,2) from the origin, frame px."""
    velocity = np.empty((frames, 2))
    now = rng.normal(0, speed_px, 2)
    for i in range(frames):
        now = 0.9 * now + rng.normal(0, 0.45 * speed_px, 2)
        velocity[i] = now
    return np.cumsum(velocity, 0) - velocity[0]


def _ground_pose(imagery: Imagery, image: int, camera: np.ndarray, zoom: float) -> Pose:
    h, w = imagery.pyramids[image][0].shape[:2]
    scale = FRAME_PX * 1.3 / min(h, w) * zoom
    middle = FRAME_PX / 2
    return Pose(middle + camera[0], middle + camera[1], scale, scale, 0.0, 0.0, False).about(w / 2, h / 2)


def _seen_box(box: Sequence[float], hider: Sequence[float] | None) -> tuple[float, float, float, float]:
    """x,y,w,h of the box within the frame; NaN where too little of it is to be seen. Both x1,y1,x2,y2."""
    area = max(_area(box), 1e-9)
    inside = (max(box[0], 0), max(box[1], 0), min(box[2], FRAME_PX), min(box[3], FRAME_PX))
    seen = _area(inside)
    if hider is not None:
        x, y = zip(inside[:2], hider[:2], strict=True), zip(inside[2:], hider[2:], strict=True)
        seen -= _area((*(max(pair) for pair in x), *(min(pair) for pair in y)))
    if seen <= (1 - HIDDEN_FRAC) * area:
        return (math.nan,) * 4
    return inside[0], inside[1], inside[2] - inside[0], inside[3] - inside[1]


def _area(box: Sequence[float]) -> float:
    return max(0.0, box[2] - box[0]) * max(0.0, box[3] - box[1])

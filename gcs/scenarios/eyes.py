"""What a scenario's camera shows, what a tracker makes of it, and whether that was right.

The tracker is either a model of one, working on boxes, or the real one, working on painted pictures.
"""

from __future__ import annotations

import math
import random
from collections import deque
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from gcs.lockstep.eyes import Eyes
from gcs.scenarios.stage import Outline, Stage, covered_frac, outlines, overlap_frac
from gcs.tracking import BoxTracker
from gcs.truth import is_on
from gcs.video.frame import Image
from sitl_mocks.camera import RenderedCamera, visible_box
from sitl_mocks.monitor import Vec3
from sitl_mocks.vehicle import Pose
from tracker.box import Box, TrackResult

_KEPT_PICTURES: Final = 200
_UNDER_WAY: Final = 50  # painted pictures kept for judging
_HIDDEN_FRAC: Final = 0.6  # covered so far, nothing is recognised any more
_LEAST_SIDE_PX: Final = 4.0


@dataclass(frozen=True, slots=True)
class Glance:
    """One picture. box: of the target as it is, None where it cannot be seen. is_hit: the tracker's box is on it."""

    box: Box | None
    is_hit: bool


@dataclass(frozen=True, slots=True)
class ModelConfig:
    """How well the modelled tracker does. Standard deviations in px, rates per picture, search in sides of the box."""

    noise_px: float = 2.0
    drift_px: float = 1.0  # a bias that wanders,
    drift_s: float = 4.0  # with this time constant
    dropout_rate: float = 0.004
    dropout_pictures: tuple[int, int] = (1, 3)
    jump_rate: float = 0.03  # over to what covers it
    search_sides: float = 4.0
    least_search_px: float = 60.0
    search_growth_ps: float = 2.0  # while hidden: the region becomes so much larger a second
    refind_rate: float = 0.6
    confidence: float = 0.9
    refound_confidence: float = 0.55
    recovery: float = 0.3  # of what is missing of the confidence, with each picture


@dataclass(slots=True)
class StageEyes(Eyes):
    """Sees a stage as boxes: the picture only carries its number."""

    stage: Stage | None = None
    glances: dict[int, Glance] = field(default_factory=dict)
    newest: Glance | None = None
    views: dict[int, list[Outline]] = field(default_factory=dict)

    def capture(self, target_ned_m: Vec3, pose: Pose) -> Image:
        """A picture of this moment."""
        assert self.stage is not None
        self.pictures += 1
        stage, world = self.stage, self.stage.world
        seen = outlines(world.state(stage.t_s), pose, self.lens)
        if stage.is_covered:
            seen = [outline for outline in seen if outline.name != world.target_name]
        self.views[self.pictures] = [o for o in seen if o.is_in(self.lens) and covered_frac(o, seen) < _HIDDEN_FRAC]
        self.views.pop(self.pictures - _KEPT_PICTURES, None)
        return _numbered(self.pictures)

    def seen_in(self, image: Image) -> list[Outline]:
        """What can be recognised in it, nearest first."""
        low, middle, high = (int(v) for v in image[0, 0])
        return self.views.get(low | middle << 8 | high << 16, [])

    def judge(self, image: Image, result: TrackResult) -> None:
        """The tracker has answered."""
        assert self.stage is not None
        name = self.stage.world.target_name
        box = next((outline.box for outline in self.seen_in(image) if outline.name == name), None)
        self.newest = Glance(box, box is not None and result.visible and is_on(result.box, box))


def _numbered(number: int) -> Image:
    return np.array([[[number >> shift & 0xFF for shift in (0, 8, 16)]]], np.uint8)


class ModelTracker:
    """A tracker of boxes: noise, drop-outs, a wandering bias; it loses what is hidden and may take a double for it."""

    def __init__(self, eyes: StageEyes, config: ModelConfig | None = None) -> None:
        self._eyes = eyes
        self._config = config or ModelConfig()
        self._random: random.Random = eyes.random
        self._name = ""
        self._box = Box(0.0, 0.0, 0.0, 0.0)
        self._bias = [0.0] * 4
        self._unseen = 0  # pictures of a drop-out still to come
        self._hidden = 0  # pictures
        self._confidence = self._config.confidence

    def init(self, frame_bgr: Image, box: Box) -> None:
        """Takes what lies most below the box."""
        seen = self._eyes.seen_in(frame_bgr)
        best = max(seen, key=lambda outline: overlap_frac(box, outline.box), default=None)
        if best is None:
            raise ValueError("there is nothing in the box")
        self._name, self._kind, self._box, self._hidden, self._unseen = best.name, best.kind, box, 0, 0
        self._confidence = self._config.confidence

    def look_at(self, cx_px: float, cy_px: float) -> None:
        """The place round which it is looked for."""
        self._box = Box(cx_px, cy_px, self._box.w_px, self._box.h_px)

    def update(self, frame_bgr: Image) -> TrackResult:
        """Where it is."""
        self._wander()
        result = self._result(self._eyes.seen_in(frame_bgr))
        self._eyes.judge(frame_bgr, result)
        return result

    def _result(self, seen: list[Outline]) -> TrackResult:
        config = self._config
        if self._unseen == 0 and self._random.random() < config.dropout_rate:
            self._unseen = self._random.randint(*config.dropout_pictures)
        if self._unseen:
            self._unseen -= 1
            return self._nothing()
        # A person is not taken for the tree that hides it, but one car for another.
        within = [outline for outline in seen if outline.kind is self._kind and self._reaches(outline)]
        found = self._refound(within) if self._hidden else self._followed(within)
        if found is None:
            self._hidden += 1
            return self._nothing()
        was_hidden, self._hidden, self._name, self._box = self._hidden, 0, found.name, found.box
        if was_hidden:
            self._confidence = config.refound_confidence
        self._confidence += config.recovery * (config.confidence - self._confidence)
        covered = max((overlap_frac(found.box, o.box) for o in seen if o.name != found.name), default=0.0)
        return TrackResult(self._noisy(found.box), 1.0, self._confidence * (1.0 - 0.6 * min(covered, 1.0)))

    def _nothing(self) -> TrackResult:
        self._eyes.unseen += 1
        return TrackResult(self._box, 0.0, 0.1, visible=False)

    def _reaches(self, outline: Outline) -> bool:
        """It lies in the search region."""
        side_px = math.sqrt(max(self._box.w_px * self._box.h_px, 1.0))
        config = self._config
        growth = 1.0 + config.search_growth_ps * self._hidden / self._eyes.fps
        reach_px = max(config.search_sides * side_px / 2, config.least_search_px) * growth
        dx, dy = outline.box.cx_px - self._box.cx_px, outline.box.cy_px - self._box.cy_px
        return max(abs(dx), abs(dy)) <= reach_px

    def _followed(self, within: list[Outline]) -> Outline | None:
        mine = next((outline for outline in within if outline.name == self._name), None)
        others = [o for o in within if o.name != self._name and overlap_frac(self._box, o.box) > 0.35]
        if others and self._random.random() < self._config.jump_rate:
            return others[0]
        return mine

    def _refound(self, within: list[Outline]) -> Outline | None:
        mine = next((outline for outline in within if outline.name == self._name), None)
        if mine is None:
            return next((o for o in within if self._random.random() < self._config.jump_rate), None)
        return mine if self._random.random() < self._config.refind_rate else None

    def _wander(self) -> None:
        config = self._config
        keep = math.exp(-1.0 / (self._eyes.fps * config.drift_s))
        kick_px = config.drift_px * math.sqrt(1.0 - keep * keep)
        self._bias = [keep * bias + kick_px * self._random.gauss(0.0, 1.0) for bias in self._bias]

    def _noisy(self, box: Box) -> Box:
        cx, cy, w, h = (bias + self._random.gauss(0.0, self._config.noise_px) for bias in self._bias)
        return Box(box.cx_px + cx, box.cy_px + cy, max(box.w_px + w, _LEAST_SIDE_PX), max(box.h_px + h, _LEAST_SIDE_PX))


@dataclass(slots=True)
class PaintedEyes(StageEyes):
    """Sees a stage as painted pictures, for the real tracker."""

    camera: RenderedCamera | None = None
    _truths: deque[tuple[Image, Box | None]] = field(default_factory=lambda: deque(maxlen=_UNDER_WAY))

    def capture(self, target_ned_m: Vec3, pose: Pose) -> Image:
        """A picture of this moment."""
        assert self.stage is not None
        if self.camera is None:
            self.camera = RenderedCamera(self.stage.world, self.lens)
        self.pictures += 1
        rendered = self.camera.render(self.stage.t_s, pose.position_ned_m, pose.roll_rad, pose.pitch_rad, pose.yaw_rad)
        truth = visible_box(rendered.truth[self.stage.world.target_name], self.lens)
        rendered.image_bgr[0, 0] = _numbered(self.pictures)  # where all stands still no two pictures are alike, either
        self._truths.append((rendered.image_bgr, None if truth is None else Box.from_xywh(*truth)))
        return rendered.image_bgr

    @property
    def painted(self) -> Box | None:
        """What the newest picture shows of the target, for the operator to draw his box round."""
        return self._truths[-1][1] if self._truths else None

    def judge(self, image: Image, result: TrackResult) -> None:
        """The tracker has answered."""
        box = next((box for picture, box in self._truths if picture is image), None)
        self.newest = Glance(box, box is not None and result.visible and is_on(result.box, box))


class JudgedTracker:
    """The real tracker, each of its answers compared with the truth."""

    def __init__(self, eyes: PaintedEyes, tracker: BoxTracker) -> None:
        self._eyes, self._tracker = eyes, tracker

    def init(self, frame_bgr: Image, box: Box) -> None:
        """Take what is in the box."""
        self._tracker.init(frame_bgr, box)

    def update(self, frame_bgr: Image) -> TrackResult:
        """Where it is in the next frame."""
        result = self._tracker.update(frame_bgr)
        self._eyes.judge(frame_bgr, result)
        return result

    def look_at(self, cx_px: float, cy_px: float) -> None:
        """Where to look for it in the next frame."""
        self._tracker.look_at(cx_px, cy_px)

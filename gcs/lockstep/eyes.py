"""The camera and the tracker of a lockstep flight, modelled: a box of the target as it truly is, with noise.

The real `Vision` judges each picture (selection, still pictures, a tracker that fails); only its thread is not
used, so that a flight is the same on every run. Geometry is the harness's own.
"""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from control.image_rotation import Flow
from gcs.flight import Flight
from gcs.flight_vision import Vision
from gcs.lockstep.background import ground_motion
from gcs.lockstep.loop import LockstepLoop
from gcs.tracking import BoxTracker
from gcs.video import Frame
from gcs.video.frame import Image
from sitl_mocks.lens import Lens
from sitl_mocks.monitor import Vec3
from sitl_mocks.vehicle import Pose
from tracker.box import Box, TrackResult

LENS = Lens()
WIDTH_PX, HEIGHT_PX = LENS.width_px, LENS.height_px
TARGET_M = (1.6, 1.6)  # width and height of what is followed


def box_of(target_ned_m: Vec3, pose: Pose, lens: Lens = LENS, size_m: tuple[float, float] = TARGET_M) -> Box | None:
    """The target's box, None where its middle is outside the picture."""
    north, east, down = (t - p for t, p in zip(target_ned_m, pose.position_ned_m, strict=True))
    c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    forward, right = north * c + east * s, east * c - north * s
    c, s = math.cos(pose.pitch_rad), math.sin(pose.pitch_rad)
    forward, down = forward * c - down * s, forward * s + down * c
    c, s = math.cos(pose.roll_rad), math.sin(pose.roll_rad)
    right, down = right * c + down * s, down * c - right * s
    c, s = math.cos(lens.mount_pitch_rad), math.sin(lens.mount_pitch_rad)
    forward, down = forward * c - down * s, forward * s + down * c
    if forward < 0.3:
        return None
    px_per_m = lens.focal_px / forward
    u, v = lens.width_px / 2 + px_per_m * right, lens.height_px / 2 + px_per_m * down
    if not (0 < u < lens.width_px and 0 < v < lens.height_px):
        return None
    return Box(u, v, size_m[0] * px_per_m, size_m[1] * px_per_m)


@dataclass(slots=True)
class Eyes:
    """What the camera and the tracker do; anybody may change the fields at any time.

    tracker: the one to be used instead of the model.
    """

    random: random.Random
    lens: Lens = LENS
    size_m: tuple[float, float] = TARGET_M
    tracker: BoxTracker | None = None
    fps: float = 20.0
    glass_s: float = 0.06  # light to picture
    track_s: float = 0.02  # picture to box
    noise_px: float = 2.0
    running: bool = True  # pictures come
    still: bool = False  # the same picture again and again, under new times
    hidden: bool = False  # the target is, and the tracker says so
    covered: bool = False  # the same, for a fault's own use
    buffered_s: float = 0.0  # pictures wait so long after they came
    confidence: float = 0.9
    distort: Callable[[Box, float], Box] = lambda box, now_s: box
    fail: Callable[[float], None] = lambda now_s: None  # may raise what a tracker raises
    pictures: int = 0
    unseen: int = 0  # pictures without a box
    delivered: int = 0
    _boxes: dict[int, Box | None] = field(default_factory=dict)
    _last: tuple[int, Image] | None = None

    def capture(self, target_ned_m: Vec3, pose: Pose) -> Image:
        """A picture of this moment."""
        if self.still and self._last is not None:
            return self._last[1]
        self.pictures += 1
        self._boxes[self.pictures] = box_of(target_ned_m, pose, self.lens, self.size_m)
        self._boxes.pop(self.pictures - 200, None)
        image = np.array([[[self.pictures >> shift & 0xFF for shift in (0, 8, 16)]]], np.uint8)
        self._last = (self.pictures, image)
        return image

    def look(self, image: Image, now_s: float) -> TrackResult:
        """What the tracker makes of a picture."""
        self.fail(now_s)
        low, middle, high = (int(v) for v in image[0, 0])
        box = self._boxes.get(low | middle << 8 | high << 16)
        if box is None or self.hidden or self.covered:
            self.unseen += 1
            return TrackResult(box or Box(WIDTH_PX / 2, HEIGHT_PX / 2, 40.0, 40.0), 0.0, 0.1, visible=False)
        noise = [self.random.gauss(0.0, self.noise_px) for _ in range(4)]
        noisy = Box(box.cx_px + noise[0], box.cy_px + noise[1], max(box.w_px + noise[2], 4.0), 0.0)
        noisy = Box(noisy.cx_px, noisy.cy_px, noisy.w_px, max(box.h_px + noise[3], 4.0))
        return TrackResult(self.distort(noisy, now_s), 1.0, self.confidence)


class ModelTracker:
    """`gcs.tracking.BoxTracker` over Eyes."""

    def __init__(self, eyes: Eyes, loop: LockstepLoop) -> None:
        self._eyes = eyes
        self._loop = loop

    def init(self, frame_bgr: Image, box: Box) -> None:
        """Any box will do: what is followed is the world's one target."""

    def update(self, frame_bgr: Image) -> TrackResult:
        """Where it is."""
        return self._eyes.look(frame_bgr, self._loop.time())

    def look_at(self, cx_px: float, cy_px: float) -> None:
        """The model needs no hint."""


class NoSource:
    """A video source that only has a size: pictures are handed to `LockstepVision` by the world."""

    name, is_live, fps, frame_count, ended, problem = "lockstep", True, 20.0, None, False, None

    def __init__(self, lens: Lens = LENS) -> None:
        self.size = (lens.width_px, lens.height_px)

    def read(self, timeout_s: float | None = None) -> Frame | None:
        """Never asked."""
        return None

    def close(self) -> None:
        """Nothing is open."""


class LockstepVision(Vision):
    """The real one without its thread. glass_delay_s: what the station takes the camera's delay for."""

    def __init__(
        self, eyes: Eyes, tracker: BoxTracker, loop: LockstepLoop, flight: Flight, *, glass_delay_s: float
    ) -> None:
        super().__init__(NoSource(eyes.lens), tracker, loop, flight.saw, flight.predicted_at, flight.glass.correction_s)
        self.eyes = eyes
        self._glass_delay_s = glass_delay_s
        self._waiting: deque[tuple[float, Frame]] = deque()
        self._due_s = loop.time()
        self._estimating = flight.config.camera.glass_delay_s is None
        self._poses: deque[tuple[int, Pose]] = deque(maxlen=200)  # by the number of the picture
        self._before: tuple[float, Pose] | None = None  # of the last picture that was tracked

    def start(self) -> None:
        """No thread."""

    def close(self) -> None:
        """Nothing is open."""

    def shoot(self, now_s: float, target_ned_m: Vec3, pose: Pose) -> None:
        """Take a picture if it is time."""
        if now_s < self._due_s:
            return
        eyes = self.eyes
        self._due_s = max(self._due_s + 1.0 / eyes.fps, now_s)
        if eyes.running:
            image = eyes.capture(target_ned_m, pose)
            self._poses.append((eyes.pictures, pose))
            arrival_s = now_s + eyes.glass_s
            done_s = arrival_s + eyes.buffered_s + eyes.track_s
            self._waiting.append((done_s, Frame(eyes.pictures, image, arrival_s - self._glass_delay_s, arrival_s)))

    def flow(self, frame: Frame, target: Box | None) -> Flow | None:
        """Of painted pictures the real one; of the model's, only where the glass delay is to be estimated."""
        if frame.image_bgr.shape[1] > 1:
            return super().flow(frame, target)
        pose = next((pose for number, pose in self._poses if number == frame.seq), None)
        if pose is None or not self._estimating:
            return None
        before, self._before = self._before, (frame.t_arrival_s, pose)
        if before is None:
            return None
        return Flow(before[0], frame.t_arrival_s, *ground_motion(self.eyes.lens, before[1], pose, frame.seq))

    def hand_over(self, now_s: float) -> None:
        """Give the program the newest picture that is through; a lost video takes along what was under way."""
        newest = None
        while self._waiting and self._waiting[0][0] <= now_s + 1e-9:
            newest = self._waiting.popleft()[1]
        if newest is not None and self.eyes.running:
            self.eyes.delivered += 1
            self._deliver(self.step(newest))

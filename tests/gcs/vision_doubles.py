"""A source that gives the frames it is told to, and a tracker that notes what it is asked."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from gcs.video import Frame
from gcs.video.frame import Image
from tracker.box import Box, TrackResult

BOX = Box(50.0, 40.0, 20.0, 10.0)


class Source:
    """A live source that gives what it is told to."""

    name = "test"
    is_live = True
    fps = 20.0
    size = (100, 80)
    frame_count = None
    problem = None

    def __init__(self, frames: Iterable[Frame] = ()) -> None:
        self._frames = iter(frames)
        self.ended = False
        self.closed = False

    def read(self, timeout_s: float | None = None) -> Frame | None:
        frame = next(self._frames, None)
        self.ended = frame is None
        return frame

    def close(self) -> None:
        self.closed = True


class Tracker:
    """Remembers the pictures it was given; fails when told to."""

    def __init__(self) -> None:
        self.began: list[tuple[Image, Box]] = []
        self.fault: Exception | None = None
        self.visible = True
        self.looked_at: list[tuple[float, float]] = []
        self.updated: list[int] = []

    def init(self, frame_bgr: Image, box: Box) -> None:
        if box.w_px < 5:
            raise ValueError("the box is too small")
        self.began.append((frame_bgr, box))

    def update(self, frame_bgr: Image) -> TrackResult:
        if self.fault is not None:
            raise self.fault
        self.updated.append(int(frame_bgr[0, 0, 0]))
        return TrackResult(BOX, 1.0, 1.0, self.visible)

    def look_at(self, cx_px: float, cy_px: float) -> None:
        self.looked_at.append((cx_px, cy_px))


def picture(seq: int) -> Frame:
    image = np.full((80, 100, 3), seq % 256, np.uint8)
    return Frame(seq, image, seq * 0.05 - 0.1, seq * 0.05)

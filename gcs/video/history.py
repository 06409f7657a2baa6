"""The pictures of the last moments, so that what an operator points at is looked for where he saw it."""

from __future__ import annotations

import math
import threading
from collections import deque
from typing import Final

from gcs.video.frame import Frame

KEPT_S: Final = 2.0
KEPT_BYTES: Final = 256 * 1024 * 1024


class FrameHistory:
    """Frames in the order of their seq, by arrival time; added on one thread, asked for on any.

    It always reaches back `kept_s`: where all pictures of that time would be more than `kept_bytes` (1080p at 30 Hz
    is 370 MB), the time is cut into as many slots as pictures fit, and each slot keeps its last picture.
    """

    def __init__(self, kept_s: float = KEPT_S, kept_bytes: int = KEPT_BYTES) -> None:
        self._kept_s, self._kept_bytes = kept_s, kept_bytes
        self._frames: deque[Frame] = deque()
        self._lock = threading.Lock()

    def add(self, frame: Frame) -> None:
        """The newest picture; what is too old goes, and of what is too much every second, third and so on."""
        fit = max(2, self._kept_bytes // max(1, frame.image_bgr.nbytes))
        slot_s = self._kept_s / max(1, fit - 2)  # the slots at both ends are begun, not full
        with self._lock:
            frames = self._frames
            if len(frames) >= 2 and _slot(frames[-1], slot_s) == _slot(frames[-2], slot_s):
                del frames[-2]
            frames.append(frame)
            while len(frames) > fit or frame.t_arrival_s - frames[0].t_arrival_s > self._kept_s:
                frames.popleft()

    def by_seq(self, seq: int) -> Frame | None:
        """The frame of this number, or the kept one nearest to it; None where it is gone or never was."""
        with self._lock:
            frames = self._frames
            if not frames or not frames[0].seq <= seq <= frames[-1].seq:
                return None
            return min(reversed(frames), key=lambda frame: abs(frame.seq - seq))

    def at(self, t_arrival_s: float) -> Frame | None:
        """The newest frame that was here then, or the oldest kept; None before the first."""
        with self._lock:
            found = next((frame for frame in reversed(self._frames) if frame.t_arrival_s <= t_arrival_s), None)
            return found or (self._frames[0] if self._frames else None)

    def since(self, seq: int) -> list[Frame]:
        """Everything kept after this number, oldest first."""
        with self._lock:
            return [frame for frame in self._frames if frame.seq > seq]

    @property
    def newest(self) -> Frame | None:
        """None before the first."""
        with self._lock:
            return self._frames[-1] if self._frames else None


def _slot(frame: Frame, slot_s: float) -> int:
    return math.floor(frame.t_arrival_s / slot_s)

"""The pictures of the last moments, so that what an operator points at is looked for where he saw it."""

from __future__ import annotations

import threading
from collections import deque
from typing import Final

from gcs.video.frame import Frame

KEPT_S: Final = 2.0
KEPT_BYTES: Final = 128 * 1024 * 1024


class FrameHistory:
    """Frames in the order of their seq, by arrival time; added on one thread, asked for on any."""

    def __init__(self, kept_s: float = KEPT_S, kept_bytes: int = KEPT_BYTES) -> None:
        self._kept_s, self._kept_bytes = kept_s, kept_bytes
        self._frames: deque[Frame] = deque()
        self._lock = threading.Lock()

    def add(self, frame: Frame) -> None:
        """The newest picture; what is too old, or too much, goes."""
        with self._lock:
            self._frames.append(frame)
            most = max(2, self._kept_bytes // max(1, frame.image_bgr.nbytes))
            while len(self._frames) > most or frame.t_arrival_s - self._frames[0].t_arrival_s > self._kept_s:
                self._frames.popleft()

    def by_seq(self, seq: int) -> Frame | None:
        """The frame of this number; None where it is gone or never was."""
        with self._lock:
            return next((frame for frame in self._frames if frame.seq == seq), None)

    def at(self, t_arrival_s: float) -> Frame | None:
        """The newest frame that was here then, or the oldest kept; None before the first."""
        with self._lock:
            found = next((frame for frame in reversed(self._frames) if frame.t_arrival_s <= t_arrival_s), None)
            return found or (self._frames[0] if self._frames else None)

    def since(self, seq: int) -> list[Frame]:
        """Everything after this number, oldest first."""
        with self._lock:
            return [frame for frame in self._frames if frame.seq > seq]

    @property
    def newest(self) -> Frame | None:
        """None before the first."""
        with self._lock:
            return self._frames[-1] if self._frames else None

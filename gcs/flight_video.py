"""The annotated video of a flight: drawn and encoded on its own thread, dropping rather than waiting."""

from __future__ import annotations

import queue
import threading
from pathlib import Path
from typing import Final

from gcs import hud
from gcs.dryrun.output import AnnotatedVideo
from gcs.video.frame import Image

_QUEUE_FRAMES: Final = 8
_CLOSE_S: Final = 5.0


class FlightVideo:
    """An mp4 whose time is the frames' own: late frames leave a repeated picture, never a shorter film."""

    def __init__(self, path: Path, size: tuple[int, int], fps: float) -> None:
        self.dropped = 0
        self._file = AnnotatedVideo(path, size, fps)
        self._first_s: float | None = None
        self._queue: queue.Queue[tuple[Image, hud.Overlay, float] | None] = queue.Queue(_QUEUE_FRAMES)
        self._thread = threading.Thread(target=self._run, name="flight video", daemon=True)
        self._thread.start()

    @property
    def problem(self) -> str | None:
        """Why there is no video, or not all of it."""
        return self._file.problem

    def write(self, image_bgr: Image, overlay: hud.Overlay, t_s: float) -> None:
        """Queue one picture, taken at t_s; never waits."""
        try:
            self._queue.put_nowait((image_bgr, overlay, t_s))
        except queue.Full:
            self.dropped += 1

    def close(self) -> None:
        """Write what is queued and finish the file (at most 6 s)."""
        try:
            self._queue.put(None, timeout=1.0)
        except queue.Full:
            return
        self._thread.join(_CLOSE_S)

    def _run(self) -> None:
        while (item := self._queue.get()) is not None:
            image_bgr, overlay, t_s = item
            if self._first_s is None:
                self._first_s = t_s
            if self._file.problem is None:
                self._file.write(hud.draw(image_bgr, overlay), t_s - self._first_s)
        self._file.close()

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

_Picture = tuple[Image, hud.Overlay, float]


class FlightVideo:
    """An mp4 whose time is the frames' own: pictures dropped leave a repeated one, never a shorter film."""

    def __init__(self, path: Path, size: tuple[int, int], fps: float) -> None:
        self.dropped = 0
        self._file = AnnotatedVideo(path, size, fps)
        self._first_s: float | None = None
        self._queue: queue.Queue[_Picture | None] = queue.Queue(_QUEUE_FRAMES)
        self._left_out: _Picture | None = None  # the newest that found no room, while none has come after it
        self._thread = threading.Thread(target=self._run, name="flight video", daemon=True)
        self._thread.start()

    @property
    def problem(self) -> str | None:
        """Why there is no video, or not all of it."""
        return self._file.problem

    def write(self, image_bgr: Image, overlay: hud.Overlay, t_s: float) -> None:
        """Queue one picture, taken at t_s; never waits."""
        picture = (image_bgr, overlay, t_s)
        try:
            self._queue.put_nowait(picture)
            self._left_out = None
        except queue.Full:
            self.dropped += 1
            self._left_out = picture

    def close(self) -> None:
        """Write what is queued and finish the file (at most 7 s); the last picture is in it."""
        try:
            if self._left_out is not None:
                self._queue.put(self._left_out, timeout=1.0)
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

"""Pictures for browsers: each encoded once for all of them, on a thread of its own, and only while somebody looks."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass

import cv2

from gcs.operator.web.report_types import PICTURE_HEAD_BYTES, picture_head
from gcs.video.frame import Frame, Image

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Picture:
    """One encoded picture; message: as it goes to a WebSocket, with the JPEG at its end."""

    seq: int
    message: bytes

    @property
    def jpeg(self) -> memoryview:
        """The JPEG alone."""
        return memoryview(self.message)[PICTURE_HEAD_BYTES:]


class Pictures:
    """Give it frames on the loop; pictures are delivered there. What is not encoded in time is replaced."""

    def __init__(self, quality: int, most_width_px: int, deliver: Callable[[Picture], None]) -> None:
        self._quality, self._most_width_px = quality, most_width_px
        self._deliver = deliver
        self._loop = asyncio.get_running_loop()
        self._changed = threading.Condition()
        self._waiting: Frame | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="page pictures", daemon=True)
        self._thread.start()

    def offer(self, frame: Frame) -> None:
        """Encode this one next; must not be written into."""
        with self._changed:
            self._waiting = frame
            self._changed.notify()

    def close(self) -> None:
        """Ends the thread, after the picture it is at."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    def _take(self) -> Frame | None:
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._waiting is not None)
            frame, self._waiting = self._waiting, None
            return None if self._closed else frame

    def _run(self) -> None:
        while (frame := self._take()) is not None:
            try:
                picture = encode(frame, self._quality, self._most_width_px)
            except (cv2.error, MemoryError) as error:
                log.warning("picture %d cannot be encoded: %s", frame.seq, error)
                continue
            with contextlib.suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(self._deliver, picture)


def encode(frame: Frame, quality: int, most_width_px: int) -> Picture:
    """The frame as a JPEG, not wider than this. Raises cv2.error for what is no picture."""
    height_px, width_px = frame.image_bgr.shape[:2]
    image = _scaled(frame.image_bgr, most_width_px)
    done, data = cv2.imencode(".jpg", image, (cv2.IMWRITE_JPEG_QUALITY, quality))
    if not done:
        raise MemoryError("no JPEG")
    return Picture(frame.seq, b"".join((picture_head(frame.seq, width_px, height_px), data.data)))


def _scaled(image: Image, most_width_px: int) -> Image:
    height_px, width_px = image.shape[:2]
    if width_px <= most_width_px:
        return image
    size = most_width_px, max(1, round(height_px * most_width_px / width_px))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)  # type: ignore[return-value]

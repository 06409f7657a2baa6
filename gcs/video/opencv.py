"""OpenCV's FFmpeg reader: files, streams and cameras, present in every installation."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import numpy as np

from gcs.errors import VideoError
from gcs.video.frame import OPEN_TIMEOUT_S, Decoded, check_size, nominal_fps, redact

# FFmpeg would hold back about a second of a stream while it guesses the format; for files the guess is free.
LIVE_OPTIONS = "rtsp_transport;tcp|fflags;nobuffer|flags;low_delay|probesize;200000|analyzeduration;500000"

# OpenCV reads this once, at the process's first use of FFmpeg (a writer counts), so it is set on import.
# What FFmpeg says per broken packet would bury our own one line; whoever wants it sets the variable himself.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)

_environment_lock = threading.Lock()


@contextmanager
def _capture_options(options: str | None) -> Iterator[None]:
    """OpenCV takes FFmpeg's options only from the process environment, read while a capture opens."""
    with _environment_lock:
        before = os.environ.pop("OPENCV_FFMPEG_CAPTURE_OPTIONS", None)
        if options or before:
            os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = before or options or ""
        try:
            yield
        finally:
            os.environ.pop("OPENCV_FFMPEG_CAPTURE_OPTIONS", None)
            if before is not None:
                os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = before


class CvDecoder:
    """One cv2.VideoCapture. Raises VideoError when nothing can be opened within `OPEN_TIMEOUT_S`."""

    def __init__(self, address: str | int, *, live: bool) -> None:
        self._name = f"camera:{address}" if isinstance(address, int) else redact(address)
        with _capture_options(LIVE_OPTIONS if live else None):
            self._capture = _open(address)
        if not self._capture.isOpened():
            reason = f"no video within {OPEN_TIMEOUT_S:.0f} s" if live else "not a video"
            raise VideoError(f"{self._name}: {reason}")
        width_px, height_px = (
            int(self._capture.get(prop)) for prop in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        )
        try:
            check_size(self._name, width_px, height_px)
        except VideoError:
            self._capture.release()
            raise

    @property
    def fps(self) -> float | None:
        return nominal_fps(self._capture.get(cv2.CAP_PROP_FPS))

    @property
    def frame_count(self) -> int | None:
        count = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))
        return count if 0 < count < 10**8 else None

    def read(self) -> Decoded | None:
        try:
            ok, image = self._capture.read()
        except cv2.error as error:
            raise VideoError(f"{self._name}: cannot be decoded ({error.err})") from error
        if not ok or image is None:
            return None
        image_bgr = np.asarray(image, dtype=np.uint8)
        return Decoded(image_bgr, self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0)

    def close(self) -> None:
        self._capture.release()


def _open(address: str | int) -> cv2.VideoCapture:
    if isinstance(address, int):
        return cv2.VideoCapture(address)
    timeout_ms = int(OPEN_TIMEOUT_S * 1000)
    limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, timeout_ms, cv2.CAP_PROP_READ_TIMEOUT_MSEC, timeout_ms]
    return cv2.VideoCapture(address, cv2.CAP_FFMPEG, limits)

"""OpenCV's FFmpeg reader: files, streams and cameras, present in every installation."""

from __future__ import annotations

import os
import re
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from urllib.parse import parse_qsl

import cv2
import numpy as np

from gcs.errors import VideoError
from gcs.video.frame import OPEN_TIMEOUT_S, SILENT_S, Decoded, check_size, nominal_fps, redact
from gcs.video.rtp import PROTOCOLS, as_opened, rtsp_transport

# FFmpeg would hold back about a second of a stream while it guesses the format; for files the guess is free.
LIVE_OPTIONS = {
    "rtsp_transport": "tcp",
    "flags": "low_delay",
    "fpsprobesize": "0",
    "analyzeduration": "100000",
    "probesize": "200000",
    "overrun_nonfatal": "1",
    "protocol_whitelist": PROTOCOLS,
}

# OpenCV reads this once, at the process's first use of FFmpeg (a writer counts), so it is set on import.
# What FFmpeg says per broken packet would bury our own one line; whoever wants it sets the variable himself.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
os.environ.setdefault("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", str(round(SILENT_S)))  # of a camera that stalls
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


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera of this machine and what is asked of it; the driver may give something else."""

    index: int
    width_px: int | None = None
    height_px: int | None = None
    fps: int | None = None
    form: str | None = None  # four letters; MJPG, where USB is too slow for raw pictures

    def ask(self, capture: cv2.VideoCapture) -> None:
        """The form first: it decides which sizes and rates there are."""
        if self.form is not None:
            capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*self.form))
        wanted = (cv2.CAP_PROP_FRAME_WIDTH, self.width_px), (cv2.CAP_PROP_FRAME_HEIGHT, self.height_px)
        for prop, value in (*wanted, (cv2.CAP_PROP_FPS, self.fps), (cv2.CAP_PROP_BUFFERSIZE, 1)):
            if value is not None:
                capture.set(prop, value)


def camera_of(address: str) -> Camera | None:
    """camera:N or /dev/videoN, with ?width=1280&height=720&fps=30&format=MJPG; None for other addresses.

    Raises VideoError for options it does not know.
    """
    found = re.fullmatch(r"(?:camera:|/dev/video)(\d{1,3})(?:\?(.*))?", address)
    if found is None:
        return None
    options = dict(parse_qsl(found.group(2) or "", keep_blank_values=True))
    form = options.pop("format", None)
    numbers = {key: options.pop(key, None) for key in ("width", "height", "fps")}
    given = [value for value in numbers.values() if value is not None]
    if options or not all(value.isdecimal() and len(value) < 5 for value in given) or (form and len(form) != 4):
        raise VideoError(f"{address}: a camera takes width, height, fps (whole numbers) and format (as MJPG)")
    width_px, height_px, fps = (None if value is None else int(value) for value in numbers.values())
    return Camera(int(found.group(1)), width_px, height_px, fps, form)


class CvDecoder:
    """One cv2.VideoCapture. Raises VideoError when nothing can be opened within `OPEN_TIMEOUT_S`."""

    def __init__(self, address: str | Camera, *, live: bool) -> None:
        self._name = f"camera:{address.index}" if isinstance(address, Camera) else redact(address)
        if isinstance(address, Camera):
            self._capture = cv2.VideoCapture(address.index, cv2.CAP_V4L2 if sys.platform == "linux" else cv2.CAP_ANY)
            if self._capture.isOpened():
                address.ask(self._capture)
        else:
            options = {**LIVE_OPTIONS, **rtsp_transport(address)}
            with as_opened(address) as opened, _capture_options(_joined(options) if live else None):
                self._capture = _open(opened)
        if not self._capture.isOpened():
            reason = f"no video within {OPEN_TIMEOUT_S:.0f} s" if live else "not a video"
            reason = "no such camera, or another program has it" if isinstance(address, Camera) else reason
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


def _joined(options: dict[str, str]) -> str:
    return "|".join(f"{key};{value}" for key, value in options.items())


def _open(address: str) -> cv2.VideoCapture:
    timeout_ms = int(OPEN_TIMEOUT_S * 1000)
    limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, timeout_ms, cv2.CAP_PROP_READ_TIMEOUT_MSEC, int(SILENT_S * 1000)]
    return cv2.VideoCapture(address, cv2.CAP_FFMPEG, limits)

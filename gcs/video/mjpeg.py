"""MJPEG over HTTP (multipart/x-mixed-replace), as IP cameras and our simulator serve it.

FFmpeg hands a part out only when the next one has begun, a whole frame late; this reader does not.
"""

from __future__ import annotations

import base64
import time
import urllib.error
import urllib.request
from http.client import HTTPException
from typing import IO
from urllib.parse import unquote, urlsplit, urlunsplit

import cv2
import numpy as np

from gcs.errors import VideoError
from gcs.video.frame import SILENT_S, Decoded, Image, check_size, redact
from gcs.video.tap import Coding, Library, Tap

MAX_PART_BYTES = 32 * 1024 * 1024
MAX_LINE_BYTES = 4096
MAX_HEADER_LINES = 64
MAX_BAD_PICTURES = 30


class NotMjpegError(VideoError):
    """The server answered with something else (a file, HLS): FFmpeg's business."""


class MjpegDecoder:
    """One HTTP answer without end. Raises VideoError if refused or silent for `SILENT_S`."""

    fps: float | None = None
    frame_count: int | None = None

    def __init__(self, url: str, tap: Tap | None = None) -> None:
        """tap: told of each picture as it came."""
        self._name = redact(url)
        try:
            # The caller's own address from the command line or the configuration, http(s) only: see open.py.
            self._answer: IO[bytes] = urllib.request.urlopen(_request(url), timeout=SILENT_S)
        except urllib.error.HTTPError as error:
            error.close()
            raise VideoError(f"{self._name}: the server answered {error.code} {error.reason}") from error
        except urllib.error.URLError as error:
            raise VideoError(f"{self._name}: {_reason(error.reason)}") from error
        except (OSError, HTTPException, ValueError) as error:
            raise VideoError(f"{self._name}: {_reason(error)}") from error
        content_type = self._answer.headers.get("Content-Type", "")
        if "multipart" not in content_type.lower():
            self._answer.close()
            raise NotMjpegError(f"{self._name}: not an MJPEG stream ({content_type or 'no content type'})")
        self._tap = tap if tap is not None and tap.opened(Coding("mjpeg", Library.OPENCV)) else None

    def read(self) -> Decoded | None:
        for _ in range(MAX_BAD_PICTURES):
            try:
                data = self._read_part()
            except (OSError, HTTPException, ValueError) as error:
                raise VideoError(f"{self._name}: {_reason(error)}") from error
            if data is None:
                return None
            image = self._decode(data)
            if image is not None:
                return image
        raise VideoError(f"{self._name}: {MAX_BAD_PICTURES} unreadable pictures in a row")

    def _decode(self, data: bytes) -> Decoded | None:
        start_s = time.monotonic()
        number = None if self._tap is None else self._tap.packet(data, start_s, is_key=True)
        image_bgr = decode_jpeg(self._name, data)
        return None if image_bgr is None else Decoded(image_bgr, None, time.monotonic() - start_s, number)

    def _read_part(self) -> bytes | None:
        """The bytes of the next part, None at the end of the stream."""
        length: int | None = None
        for _ in range(MAX_HEADER_LINES):
            line = self._answer.readline(MAX_LINE_BYTES)
            if not line:
                return None
            key, _, value = line.partition(b":")
            if key.strip().lower() == b"content-length":
                length = int(value)
            elif not line.strip() and length is not None:
                return self._read_exactly(length)
            elif line.startswith(b"\xff\xd8"):
                return self._read_until_end_of_image(line)
        raise ValueError("not in the multipart form")

    def _read_exactly(self, length: int) -> bytes | None:
        if not 0 < length <= MAX_PART_BYTES:
            raise ValueError(f"a picture of {length} bytes")
        data = self._answer.read(length)
        return data if len(data) == length else None

    def _read_until_end_of_image(self, data: bytes) -> bytes | None:
        """For servers that send no Content-Length: up to the line that holds the end-of-image marker."""
        parts, total = [data], len(data)
        while b"\xff\xd9" not in parts[-1]:
            line = self._answer.readline(MAX_PART_BYTES)
            parts.append(line)
            total += len(line)
            if not line:
                return None
            if total > MAX_PART_BYTES:
                raise ValueError(f"a picture of more than {MAX_PART_BYTES} bytes")
        return b"".join(parts)

    def close(self) -> None:
        self._answer.close()


def decode_jpeg(name: str, data: bytes) -> Image | None:
    """None for what is none; VideoError for one that is too large."""
    size = jpeg_size(data)
    if size is None:
        return None
    check_size(name, *size)
    try:
        image_bgr = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:
        return None
    return None if image_bgr is None else np.asarray(image_bgr, np.uint8)


def jpeg_size(data: bytes) -> tuple[int, int] | None:
    """(width, height) in px from a JPEG's frame header, without decoding it; None if it is no JPEG."""
    if not data.startswith(b"\xff\xd8"):
        return None
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            return int.from_bytes(data[at + 7 : at + 9], "big"), int.from_bytes(data[at + 5 : at + 7], "big")
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return None


def _request(url: str) -> urllib.request.Request:
    """urllib does not take `user:password@host` by itself; cameras are given like that."""
    parts = urlsplit(url)
    host = parts.netloc.rpartition("@")[2]
    request = urllib.request.Request(urlunsplit(parts._replace(netloc=host)))
    if parts.username is not None:
        pair = f"{unquote(parts.username)}:{unquote(parts.password or '')}"
        request.add_header("Authorization", "Basic " + base64.b64encode(pair.encode()).decode())
    return request


def _reason(error: object) -> str:
    if isinstance(error, TimeoutError):
        return f"silent for {SILENT_S:.0f} s"
    return str(getattr(error, "strerror", None) or error).lower()

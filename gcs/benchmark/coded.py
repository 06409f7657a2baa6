"""Coding and decoding of video, as the station does both; needs PyAV, and says so where it is missing."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

import cv2
import numpy as np

from gcs.benchmark.films import Image
from gcs.benchmark.timing import Case, Repeated
from gcs.video.decoding import to_bgr
from gcs.video.pyav import is_installed
from gcs.video_out.encoder import TICKS_HZ, Coded, Encoder

FPS: Final = 30
_BITRATE_KBPS: Final = 4000


def h264_cases(images: Sequence[Image], note: Callable[[str], None], label: str = "") -> Iterator[Case]:
    """Encoding for receivers elsewhere, and decoding of a camera's stream."""
    if not is_installed():
        note("H.264: needs PyAV: pip install climrt-gcs[video]")
        return
    yield Repeated(f"H.264 encode{label}", _Encode(images))
    yield Repeated(f"H.264 decode{label}", Decode(images))


def jpeg_case(image: Image, label: str = "") -> Case:
    """Decoding of one picture of Motion JPEG."""
    data = np.frombuffer(jpeg(image), np.uint8)
    return Repeated(f"JPEG decode{label}", lambda: cv2.imdecode(data, cv2.IMREAD_COLOR))


def jpeg(image: Image) -> bytes:
    """As a camera sends it."""
    return bytes(cv2.imencode(".jpg", image, (cv2.IMWRITE_JPEG_QUALITY, 80))[1].data)


def coded(images: Sequence[Image], *, key_every: int | None = None) -> list[Coded]:
    """As H.264, one piece a picture. key_every: so often a receiver can join; None: only at the first."""
    height, width = images[0].shape[:2]
    encoder = Encoder((width, height), _BITRATE_KBPS, FPS)
    every = key_every or len(images)
    return [
        encoder.encode(image, number, number * TICKS_HZ // FPS, key=number % every == 0)
        for number, image in enumerate(images)
    ]


class _Encode:
    """One picture after the other of an endless stream."""

    def __init__(self, images: Sequence[Image]) -> None:
        height, width = images[0].shape[:2]
        self._encoder = Encoder((width, height), _BITRATE_KBPS, FPS)
        self._images, self._number = images, 0

    def __call__(self) -> object:
        number, self._number = self._number, self._number + 1
        image = self._images[number % len(self._images)]
        return self._encoder.encode(image, number, number * TICKS_HZ // FPS, key=number == 0)


class Decode:
    """One picture after the other, to BGR, on one thread; the stream begins again where it ends."""

    def __init__(self, images: Sequence[Image]) -> None:
        import av  # an optional package: the module must import without it

        self._packets = [av.Packet(each.data) for each in coded(images)]
        self._context: Any = av.CodecContext.create("h264", "r")
        self._context.thread_count = 1
        self._context.flags |= av.codec.context.Flags.low_delay
        self._next = 0

    def __call__(self) -> Image | None:
        packet = self._packets[self._next]
        self._next = (self._next + 1) % len(self._packets)
        image = None
        for frame in self._context.decode(packet):
            image = to_bgr(frame)
        return image

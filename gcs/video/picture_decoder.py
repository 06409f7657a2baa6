"""Recorded packets to the pictures that a live source gave of them."""

from __future__ import annotations

from typing import Any, Protocol

from gcs.errors import VideoError
from gcs.video import pyav
from gcs.video.decoding import PacketDecoder, to_bgr
from gcs.video.frame import Image, check_size
from gcs.video.mjpeg import decode_jpeg
from gcs.video.tap import Coding, Library


class PictureDecoder(Protocol):
    """Given all packets in order, asked for the pictures that are wanted."""

    def take(self, data: bytes, *, is_key: bool, skips: bool) -> None:
        """The next packet, see `Tap.packet`; a damaged one gives no picture."""
        ...

    def picture(self) -> Image | None:
        """The newest of those the last packet completed. VideoError for one that is too large."""
        ...


def open_decoder(name: str, coding: Coding) -> PictureDecoder:
    """Raises VideoError, which names the film, where its codec cannot be decoded here."""
    if coding.library is Library.OPENCV:
        return _Jpegs(name)
    if not pyav.is_installed():
        raise VideoError(f"{name}: {coding.codec} needs PyAV: pip install 'climrt-gcs[video]'")
    return _Ffmpeg(name, coding)


class _Jpegs:
    def __init__(self, name: str) -> None:
        self._name = name
        self._data = b""

    def take(self, data: bytes, *, is_key: bool, skips: bool) -> None:
        self._data = data

    def picture(self) -> Image | None:
        return decode_jpeg(self._name, self._data)


class _Ffmpeg:
    def __init__(self, name: str, coding: Coding) -> None:
        import av

        self._error = av.FFmpegError
        self._name = name
        av.logging.set_libav_level(av.logging.PANIC)
        try:
            self._decoder = PacketDecoder(coding)
        except (av.FFmpegError, ValueError) as error:
            raise VideoError(f"{name}: {coding.codec} cannot be decoded here") from error
        self._frames: list[Any] = []

    def take(self, data: bytes, *, is_key: bool, skips: bool) -> None:
        try:
            self._frames = self._decoder.decode(data, is_key=is_key, skips=skips)
        except self._error:
            self._frames = []

    def picture(self) -> Image | None:
        if not self._frames:
            return None
        frame = self._frames[-1]
        check_size(self._name, frame.width, frame.height)
        return to_bgr(frame)

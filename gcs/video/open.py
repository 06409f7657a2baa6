"""From an address on the command line to a `VideoSource`."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from gcs.errors import VideoError
from gcs.video import pyav
from gcs.video.frame import Decoder, VideoSource, redact
from gcs.video.live import LiveSource
from gcs.video.mjpeg import MjpegDecoder, NotMjpegError
from gcs.video.opencv import CvDecoder
from gcs.video.recorded import FolderDecoder, RecordedSource

STREAM_SCHEMES = frozenset({"rtsp", "rtsps", "rtmp", "udp", "rtp", "tcp", "srt", "http", "https"})


def open_source(
    address: str, *, glass_delay_s: float = 0.0, fps: float | None = None, reconnect: bool = True
) -> VideoSource:
    """Open a file, an image folder, a stream (rtsp, rtmp, udp, rtp, tcp, srt, http) or `camera:N`.

    glass_delay_s, reconnect: live sources only. fps: rate of an image folder (30 if not said).
    Raises VideoError with one line that says what is wrong.
    """
    camera = re.fullmatch(r"camera:(\d{1,3})|/dev/video(\d{1,3})", address)
    scheme = re.match(r"([A-Za-z][A-Za-z0-9+.-]*)://", address)
    if camera is None and scheme is None:
        return _open_recorded(Path(address), fps)
    if camera is not None:
        index = int(camera.group(1) or camera.group(2))
        opener: Callable[[], Decoder] = lambda: CvDecoder(index, live=True)  # noqa: E731
    elif scheme is not None and scheme.group(1).lower() in STREAM_SCHEMES:
        opener = lambda: _open_stream(address)  # noqa: E731
    else:
        known = ", ".join(sorted(STREAM_SCHEMES))
        raise VideoError(f"{redact(address)}: unknown kind of address; use one of {known}")
    return LiveSource(redact(address), opener, glass_delay_s=glass_delay_s, reconnect=reconnect)


def _open_recorded(path: Path, fps: float | None) -> VideoSource:
    try:
        if path.is_dir():
            return RecordedSource(str(path), FolderDecoder(path, fps))
        if not path.exists():
            raise VideoError(f"{path}: no such file")
        if path.stat().st_size == 0:
            raise VideoError(f"{path}: empty file")
        with path.open("rb"):
            pass
    except OSError as error:
        raise VideoError(f"{path}: {(error.strerror or str(error)).lower()}") from error
    try:
        return RecordedSource(str(path), CvDecoder(str(path), live=False))
    except VideoError as error:
        if not pyav.is_installed():
            raise
        try:
            return RecordedSource(str(path), pyav.AvDecoder(str(path), live=False))
        except VideoError:
            raise error from None


def _open_stream(url: str) -> Decoder:
    if url.lower().startswith(("http://", "https://")):
        try:
            return MjpegDecoder(url)
        except NotMjpegError:
            pass  # an HTTP answer of another kind (a file, HLS) is FFmpeg's to read
    if pyav.is_installed():
        return pyav.AvDecoder(url, live=True)
    return CvDecoder(url, live=True)

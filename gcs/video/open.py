"""From an address on the command line to a `VideoSource`."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

from gcs.errors import VideoError
from gcs.video import pyav
from gcs.video.frame import Decoder, VideoSource, redact
from gcs.video.live import LiveSource
from gcs.video.mjpeg import MjpegDecoder, NotMjpegError
from gcs.video.opencv import CvDecoder, camera_of
from gcs.video.recorded import FolderDecoder, RecordedSource
from gcs.video.rtp import is_sdp
from gcs.video.tap import Tap

STREAM_SCHEMES = frozenset({"rtsp", "rtsps", "rtmp", "udp", "rtp", "tcp", "srt", "http", "https"})


def open_source(
    address: str,
    *,
    glass_delay_s: float = 0.0,
    fps: float | None = None,
    reconnect: bool = True,
    tap: Tap | None = None,
) -> VideoSource:
    """Open a file, an image folder, a stream (rtsp, rtmp, udp, rtp, tcp, srt, http, an .sdp file) or `camera:N`.

    Options in the address: camera:0?width=1280&height=720&fps=30&format=MJPG, rtsp://...?transport=udp,
    rtp://HOST:PORT?codec=h265&payload=97.
    glass_delay_s, reconnect, tap: live sources only. fps: rate of an image folder (30 if not said).
    Raises VideoError with one line that says what is wrong.
    """
    camera = camera_of(address)
    scheme = re.match(r"([A-Za-z][A-Za-z0-9+.-]*)://", address)
    if camera is None and scheme is None and not is_sdp(address):
        return _open_recorded(Path(address), fps)
    if camera is not None:
        opener: Callable[[], Decoder] = lambda: CvDecoder(camera, live=True)  # noqa: E731
    elif scheme is None:
        _check_file(Path(address))
        opener = lambda: _open_stream(address, tap)  # noqa: E731
    elif scheme.group(1).lower() in STREAM_SCHEMES:
        _check_address(address)
        opener = lambda: _open_stream(address, tap)  # noqa: E731
    else:
        known = ", ".join(sorted(STREAM_SCHEMES))
        raise VideoError(f"{redact(address)}: unknown kind of address; use one of {known}")
    return LiveSource(redact(address), opener, glass_delay_s=glass_delay_s, reconnect=reconnect, tap=tap)


def _open_recorded(path: Path, fps: float | None) -> VideoSource:
    if path.is_dir():
        return RecordedSource(str(path), FolderDecoder(path, fps))
    _check_file(path)
    try:
        return RecordedSource(str(path), CvDecoder(str(path), live=False))
    except VideoError as error:
        if not pyav.is_installed():
            raise
        try:
            return RecordedSource(str(path), pyav.AvDecoder(str(path), live=False))
        except VideoError as said:
            raise said if "holds no video" in str(said) else error from None


def _check_address(address: str) -> None:
    """VideoError for a port that is none: FFmpeg would take another and wait there. RTP's own check says more."""
    try:
        parts = urlsplit(address)
        _ = parts.scheme == "rtp" or parts.port
    except ValueError as error:
        raise VideoError(f"{redact(address)}: no such address: {str(error).lower()}") from None


def _check_file(path: Path) -> None:
    """Raise VideoError unless there is something in it to read."""
    try:
        if not path.exists():
            raise VideoError(f"{path}: no such file")
        if path.stat().st_size == 0:
            raise VideoError(f"{path}: empty file")
        with path.open("rb"):
            pass
    except OSError as error:
        raise VideoError(f"{path}: {(error.strerror or str(error)).lower()}") from error


def _open_stream(url: str, tap: Tap | None) -> Decoder:
    if url.lower().startswith(("http://", "https://")):
        try:
            return MjpegDecoder(url, tap)
        except NotMjpegError:
            pass  # an HTTP answer of another kind (a file, HLS) is FFmpeg's to read
    if pyav.is_installed():
        return pyav.AvDecoder(url, live=True, tap=tap)
    return CvDecoder(url, live=True)

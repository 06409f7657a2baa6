"""Streams that come in packets: which addresses they are, and how FFmpeg is told what an RTP port carries."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final
from urllib.parse import SplitResult, parse_qs, urlsplit

from gcs.errors import VideoError
from gcs.video.frame import redact

# Without a list FFmpeg lets an SDP file open nothing but files.
PROTOCOLS: Final = "file,crypto,data,rtp,srtp,udp,tcp,tls,rtsp,rtsps,rtmp,rtmps,srt,http,https,httpproxy"
CODECS: Final = {"h264": "H264", "h265": "H265", "hevc": "H265"}
PAYLOAD: Final = 96  # as QGroundControl, GStreamer and FFmpeg number the first dynamic format


def is_sdp(address: str) -> bool:
    """Whether this is a file that describes an RTP stream."""
    return "://" not in address and address.lower().endswith(".sdp")


def may_be_mpegts(address: str) -> bool:
    """Whether the address is one that MPEG-TS comes from."""
    return urlsplit(address).scheme.lower() in ("udp", "srt")


def rtsp_transport(address: str) -> dict[str, str]:
    """FFmpeg's option for `rtsp://...?transport=udp`; empty where the address does not say."""
    parts = urlsplit(address)
    wanted = parse_qs(parts.query).get("transport", [])
    if not parts.scheme.lower().startswith("rtsp") or not wanted:
        return {}
    if wanted[0] not in ("tcp", "udp"):
        raise VideoError(f"{redact(address)}: transport is tcp or udp, not {wanted[0]}")
    return {"rtsp_transport": wanted[0]}


@contextmanager
def as_opened(address: str) -> Iterator[str]:
    """What FFmpeg is to open: for rtp://HOST:PORT an SDP file that lives as long as the opening takes."""
    parts = urlsplit(address)
    scheme = parts.scheme.lower()
    if scheme.startswith("rtsp"):
        yield _without_transport(parts)
    elif scheme == "rtp":
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "stream.sdp"
            path.write_text(_sdp(address, parts))
            yield str(path)
    else:
        yield address


def _without_transport(parts: SplitResult) -> str:
    kept = [each for each in parts.query.split("&") if each and not each.startswith("transport=")]
    return parts._replace(query="&".join(kept)).geturl()


def _sdp(address: str, parts: SplitResult) -> str:
    query = parse_qs(parts.query)
    codec = CODECS.get(query.get("codec", ["h264"])[0].lower())
    payload = query.get("payload", [str(PAYLOAD)])[0]
    try:
        port = parts.port
    except ValueError:
        port = None
    if codec is None or port is None or not (payload.isdecimal() and 96 <= int(payload) <= 127):
        raise VideoError(f"{redact(address)}: an RTP address is rtp://HOST:PORT?codec=h264|h265&payload=96..127")
    host = parts.hostname or "0.0.0.0"
    version = "IP6" if ":" in host else "IP4"
    return (
        f"v=0\no=- 0 0 IN {version} {host}\ns=video\nc=IN {version} {host}\nt=0 0\n"
        f"m=video {port} RTP/AVP {payload}\na=rtpmap:{payload} {codec}/90000\n"
    )

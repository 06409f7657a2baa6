"""Pictures to H.264 that starts anywhere within a second and holds nothing back (libx264 through PyAV)."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from importlib.util import find_spec
from typing import Any, Final

import cv2
import numpy as np

from gcs.errors import GcsError
from gcs.video.frame import Image

TICKS_HZ: Final = 90_000  # RTP's clock for video (RFC 6184)
TIME_BASE: Final = Fraction(1, TICKS_HZ)
_BUFFER_S: Final = 0.25  # of the bit rate: bounds how long a key frame is on the way
_KEY_FRAMES: Final = 600  # where nobody asks for one in between
_USUAL_FPS: Final = 25.0
_RATE_OFF: Final = 1.25  # times: the bit rate is shared out by pictures, not by time, which would cost one of delay


@dataclass(frozen=True, slots=True)
class Coded:
    """One picture as H.264 with start codes (Annex B); ticks: its time in 1/90000 s."""

    seq: int
    ticks: int
    data: bytes
    is_key: bool


def require_av() -> None:
    """Raise GcsError, with what to install, where PyAV is missing."""
    if find_spec("av") is None:
        raise GcsError("H.264 video needs PyAV: pip install climrt-gcs[video]")


class Encoder:
    """For pictures of one size (an odd last row or column is left out); on one thread at a time.

    Baseline profile and one slice a picture, which every receiver takes; key frames come with SPS and PPS.
    """

    def __init__(self, size: tuple[int, int], bitrate_kbps: int, fps: float | None = None) -> None:
        """size: (width, height) in px; fps: as near as known, for the bit rate's sake."""
        import av  # an optional package: the module must import without it

        self._av: Any = av
        self.size = size
        self._fps = _known(fps)
        context = av.CodecContext.create("libx264", "w")
        context.width, context.height = size[0] // 2 * 2, size[1] // 2 * 2
        context.pix_fmt = "yuv420p"
        context.time_base, context.framerate = TIME_BASE, Fraction(round(self._fps * 1000), 1000)
        context.bit_rate = bitrate_kbps * 1000
        context.gop_size, context.max_b_frames, context.thread_count = _KEY_FRAMES, 0, 1
        context.options = {
            "preset": "ultrafast",
            "tune": "zerolatency",
            "profile": "baseline",
            "forced-idr": "1",
            "maxrate": str(bitrate_kbps * 1000),
            "bufsize": str(round(bitrate_kbps * 1000 * _BUFFER_S)),
        }
        self._context: Any = context

    def suits(self, size: tuple[int, int], fps: float | None) -> bool:
        """It still keeps to its bit rate with these pictures; another size it cannot encode at all."""
        off = _known(fps) / self._fps
        return size == self.size and 1 / _RATE_OFF <= off <= _RATE_OFF

    def encode(self, image_bgr: Image, seq: int, ticks: int, *, key: bool) -> Coded:
        """The picture (H, W, 3) of this size; ticks must grow. GcsError where it cannot be encoded."""
        width, height = self._context.width, self._context.height
        planes = cv2.cvtColor(np.ascontiguousarray(image_bgr[:height, :width]), cv2.COLOR_BGR2YUV_I420)
        try:
            frame = self._av.VideoFrame.from_ndarray(planes, format="yuv420p")
            frame.pts, frame.time_base = ticks, TIME_BASE
            kinds = self._av.video.frame.PictureType
            frame.pict_type = kinds.I if key else kinds.NONE
            packets = list(self._context.encode(frame))
        except (self._av.FFmpegError, ValueError) as error:
            raise GcsError(f"video out: {width}x{height} px cannot be encoded ({error})") from error
        return Coded(seq, ticks, b"".join(bytes(each) for each in packets), any(each.is_keyframe for each in packets))


def _known(fps: float | None) -> float:
    return fps if fps is not None and 1.0 <= fps <= 120.0 else _USUAL_FPS


def parameter_sets(size: tuple[int, int], bitrate_kbps: int) -> tuple[bytes, bytes]:
    """(SPS, PPS) of such a stream, without start codes: what a receiver may be told before the first picture."""
    grey = np.full((size[1], size[0], 3), 128, np.uint8)
    data = Encoder(size, bitrate_kbps).encode(grey, 0, 0, key=True).data
    units = {unit[0] & 0x1F: unit for unit in nal_units(data) if unit}
    return units[7], units[8]


def nal_units(data: bytes) -> list[bytes]:
    """What stands between the start codes of Annex B."""
    return [unit.rstrip(b"\0") for unit in data.split(b"\0\0\1")[1:]]

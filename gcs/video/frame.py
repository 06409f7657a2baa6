"""What every video source gives, and what a decoder must do to become one."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt
import xxhash

from gcs.errors import VideoError

Image = npt.NDArray[np.uint8]

MAX_SIDE_PX = 4096
MAX_AREA_PX = 4096 * 2160
OPEN_TIMEOUT_S = 5.0
SILENT_S = 3.0  # a stream that sends nothing for so long is opened anew


@dataclass(frozen=True, slots=True)
class Frame:
    """One picture and its times.

    seq: counts every decoded frame of the source from 0, so a gap tells how many a slow reader missed.
    image_bgr: (height, width, 3) uint8; the receiver must not write into it.
    t_capture_s: when the light fell on the sensor; t_arrival_s: when the encoded picture was here, or where the
    decoder cannot tell, the decoded one. For live sources both are on the monotonic clock, for recorded ones both
    are the video's own time from 0. decode_s: from arrival to the decoded picture. packet: number of the packet that
    held it, as a `gcs.video.tap.Tap` counts them.
    """

    seq: int
    image_bgr: Image
    t_capture_s: float
    t_arrival_s: float
    decode_s: float = 0.0
    packet: int | None = None


@dataclass(frozen=True, slots=True)
class Decoded:
    """One picture as a decoder gives it.

    pts_s: time in the video (s), None where it knows none. decode_s: since its last byte was here, as far as known.
    packet: see `Frame`.
    """

    image_bgr: Image
    pts_s: float | None = None
    decode_s: float = 0.0
    packet: int | None = None


class Decoder(Protocol):
    """Pictures one after the other, blocking; knows nothing of clocks, threads or dropping."""

    @property
    def fps(self) -> float | None: ...

    @property
    def frame_count(self) -> int | None: ...

    def read(self) -> Decoded | None:
        """The next picture, or None at the end. Raises VideoError where the data cannot be read."""
        ...

    def close(self) -> None: ...


class VideoSource(Protocol):
    """Frames for the program, from whatever medium."""

    @property
    def name(self) -> str: ...

    @property
    def is_live(self) -> bool: ...

    @property
    def fps(self) -> float | None:
        """Nominal rate, None where the medium does not say."""
        ...

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in px."""
        ...

    @property
    def frame_count(self) -> int | None:
        """How many frames the medium claims to hold; None for live ones or where it does not say."""
        ...

    @property
    def ended(self) -> bool:
        """No frame will ever come again."""
        ...

    @property
    def problem(self) -> str | None:
        """One line on what went wrong on the way although frames were delivered, e.g. a truncated file."""
        ...

    def read(self, timeout_s: float | None = None) -> Frame | None:
        """The next frame (recorded) or the newest not yet given (live); None: nothing in time, or `ended`."""
        ...

    def close(self) -> None: ...


def check_size(name: str, width_px: int, height_px: int) -> None:
    """Raise VideoError for a picture larger than the program will decode (hostile or mistaken input)."""
    if max(width_px, height_px) > MAX_SIDE_PX or width_px * height_px > MAX_AREA_PX:
        raise VideoError(
            f"{name}: {width_px}x{height_px} px is more than the 4096x2160 px supported; scale it down first"
        )


def nominal_fps(value: float) -> float | None:
    """A container's claimed rate if it can be true (it says 90000 or 0 where it does not know)."""
    return value if 0.5 <= value <= 480.0 else None


def fingerprint(image_bgr: Image) -> int:
    """64 bits that tell this picture from any other (XXH3); a tenth of a millisecond for the largest."""
    return xxhash.xxh3_64_intdigest(np.ascontiguousarray(image_bgr).data)


_LETS_IN: Final = re.compile(r"(?i)([?&/_](?:user\w*|login|pass\w*|pwd|token|secret|auth\w*|\w*key)=)[^&#/\s]+")


def redact(url: str) -> str:
    """The address without user name, password or other secret, for messages and logs."""
    return _LETS_IN.sub(r"\1***", re.sub(r"(?<=://)[^/\s]+@", "***@", url))

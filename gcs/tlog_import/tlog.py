"""Telemetry logs of any ground station: 8 bytes of wall clock (µs since 1970) before each MAVLink frame.

The clock is big-endian; old logs of QGroundControl have it the other way round.
"""

from __future__ import annotations

import mmap
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from gcs.errors import GcsError
from gcs.framing import MARKER_V1, MARKER_V2, frame_length
from gcs.regular_file import open_regular

_STAMP_BYTES: Final = 8
_HEAD_BYTES: Final = 3  # of a frame, which tell its length
_MARKERS: Final = frozenset({MARKER_V1, MARKER_V2})
_MARKER: Final = re.compile(b"[\xfd\xfe]")
_LOOKED_AT_BYTES: Final = 4_000_000  # whatever begins with so much of something else is something else
_MOST_STEP_US: Final = 3_600_000_000  # a longer one is the clock being set
_LAST_US: Final = 4_102_444_800_000_000  # the year 2100: later, the bytes are the other way round
_LEAST_STEP_US: Final = -1_000_000  # two threads of a station write a little out of order


class TlogError(GcsError):
    """A file that is no telemetry log, or holds no vehicle; names it."""


class Tlog:
    """The frames of a log, both directions mixed; each iteration reads it anew, in constant memory.

    Figures are those of the iteration so far. skipped_bytes: between frames. clock_steps: how often the wall clock was
    set meanwhile. span_s: from the first frame to the last, without these steps. unix_start_s: of the first frame, by
    the clock as it was set last.
    """

    def __init__(self, path: Path) -> None:
        """Raises TlogError where there is no such file, or nothing in it."""
        self.path = path
        try:
            with open_regular(path) as file:
                self._data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except OSError as error:
            raise TlogError(f"{path}: {(error.strerror or str(error)).lower()}") from error
        except ValueError:
            raise TlogError(f"{path}: empty") from None
        self._begin()

    def _begin(self) -> None:
        self.frames = self.skipped_bytes = self.clock_steps = 0
        self.span_s = self.unix_start_s = 0.0
        self._t_us = self._stamp_us = 0

    @property
    def size_bytes(self) -> int:
        """Of the file."""
        return len(self._data)

    def __iter__(self) -> Iterator[tuple[float, bytes]]:
        """Seconds since the first frame, never less than before, and the frame; its checksum is not looked at.

        Raises TlogError where the file begins with something else.
        """
        self._begin()
        at, end, expected = 0, len(self._data), 0
        while at < end:
            length = self._length(at, is_expected=at == expected)
            if length:
                self._take(_stamp_us(self._data[at : at + _STAMP_BYTES]))
                begin, at = at + _STAMP_BYTES, at + _STAMP_BYTES + length
                expected = at
                yield self.span_s, self._data[begin:at]
                continue
            if not self.frames and at > _LOOKED_AT_BYTES:
                break
            marker = _MARKER.search(self._data, at + _STAMP_BYTES + 1)
            following = marker.start() - _STAMP_BYTES if marker is not None else end
            self.skipped_bytes, at = self.skipped_bytes + following - at, following
        if not self.frames:
            raise TlogError(f"{self.path}: not a telemetry log: no MAVLink frames with their times in it")

    def _length(self, at: int, *, is_expected: bool) -> int:
        """Bytes of the frame behind the stamp there; 0 where there is none, which the next one tells best."""
        data, begin = self._data, at + _STAMP_BYTES
        if begin >= len(data) or data[begin] not in _MARKERS:
            return 0
        length = frame_length(data[begin : begin + _HEAD_BYTES], 0) or 0
        following = begin + length + _STAMP_BYTES
        if not length or begin + length > len(data):
            return 0
        is_one = is_expected if following >= len(data) else data[following] in _MARKERS
        return length if is_one else 0

    def _take(self, stamp_us: int) -> None:
        step_us = stamp_us - self._stamp_us
        if stamp_us >= _LAST_US:
            self.clock_steps += 1  # no time at all: the frame comes with the one before
        elif self.frames == 0:
            self._set_clock(stamp_us)
        elif _LEAST_STEP_US <= step_us <= _MOST_STEP_US:
            self._t_us += max(step_us, 0)
            self._stamp_us = max(stamp_us, self._stamp_us)
        else:
            self.clock_steps += 1
            self._set_clock(stamp_us)
        self.frames += 1
        self.span_s = self._t_us / 1e6

    def _set_clock(self, stamp_us: int) -> None:
        self._stamp_us = stamp_us
        self.unix_start_s = (stamp_us - self._t_us) / 1e6

    def close(self) -> None:
        """Close the file."""
        self._data.close()


def _stamp_us(data: bytes) -> int:
    stamp_us = int.from_bytes(data, "big")
    return stamp_us if stamp_us < _LAST_US else int.from_bytes(data, "little")

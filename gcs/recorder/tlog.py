"""Telemetry log of both directions, as other ground stations write it: 8 bytes of time, then the frame."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from gcs.recorder.batch import BatchWriter

_STAMP = struct.Struct(">Q")  # µs of the wall clock, big-endian
_QUEUE_FRAMES: Final = 20_000


class TlogWriter(BatchWriter[bytes]):
    """Writes on its own thread; a full disk ends the log with one warning and leaves the flight alone."""

    def __init__(
        self, path: Path, open_file: Callable[[Path], Any] = lambda path: path.open("xb", buffering=0)
    ) -> None:
        """A new file; where it exists already it is left as it is, and `problem` says so."""
        super().__init__(path, b"".join, most=_QUEUE_FRAMES, open_file=open_file)

    def write(self, frame: bytes, wall_s: float) -> None:
        """Queue one frame; wall_s is seconds of the Unix epoch. Never blocks, never raises."""
        self.put(_STAMP.pack(int(wall_s * 1e6)) + frame)

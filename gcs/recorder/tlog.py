"""Telemetry log of both directions, as other ground stations write it: 8 bytes of time, then the frame."""

from __future__ import annotations

import logging
import struct
import threading
from collections import deque
from pathlib import Path
from typing import IO, Final

from gcs.errors import WireError

_STAMP = struct.Struct(">Q")  # µs of the wall clock, big-endian
_QUEUE_FRAMES = 20_000  # a slow disk is waited for on this thread, never on the wire's
_WRITE_S: Final = (
    0.1  # so often, all at once: waking up for each of hundreds of frames a second costs more than they do
)
log = logging.getLogger(__name__)


class TlogWriter:
    """Writes on its own thread; a full disk ends the log with one warning and leaves the flight alone."""

    def __init__(self, file: IO[bytes], name: str) -> None:
        self._file = file
        self._name = name
        self._waiting: deque[bytes] = deque()
        self._ending = threading.Event()
        self._failed = False
        self.dropped = 0  # frames not logged: disk too slow or full
        self._thread = threading.Thread(target=self._run, name="tlog", daemon=True)
        self._thread.start()

    @classmethod
    def create(cls, path: Path) -> TlogWriter:
        """A new file; WireError if it exists already or cannot be made."""
        try:
            return cls(path.open("xb"), str(path))
        except OSError as error:
            raise WireError(f"telemetry log {path}: {error.strerror}") from None

    def write(self, frame: bytes, wall_s: float) -> None:
        """Queue one frame; wall_s is seconds of the Unix epoch. Never blocks, never raises."""
        if len(self._waiting) >= _QUEUE_FRAMES:
            self.dropped += 1
        else:
            self._waiting.append(_STAMP.pack(int(wall_s * 1e6)) + frame)

    def close(self) -> None:
        """Write what is queued and close the file (blocks at most 2 s)."""
        self._ending.set()
        self._thread.join(2.0)

    def _run(self) -> None:
        while not self._ending.wait(_WRITE_S):
            self._write()
        self._write()
        try:
            self._file.close()
        except OSError as error:
            self._fail(error, 1)

    def _write(self) -> None:
        records = [self._waiting.popleft() for _ in range(len(self._waiting))]
        if self._failed:
            self.dropped += len(records)
        elif records:
            try:
                self._file.write(b"".join(records))
                self._file.flush()
            except OSError as error:
                self._fail(error, len(records))

    def _fail(self, error: OSError, frames: int) -> None:
        self._failed = True
        self.dropped += frames
        log.warning("telemetry log %s ends here: %s", self._name, error.strerror)

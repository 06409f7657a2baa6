"""Telemetry log of both directions, as other ground stations write it: 8 bytes of time, then the frame."""

from __future__ import annotations

import logging
import queue
import struct
import threading
from pathlib import Path
from typing import IO

from gcs.errors import WireError

_STAMP = struct.Struct(">Q")  # µs of the wall clock, big-endian
_QUEUE_FRAMES = 20_000  # a slow disk is waited for on this thread, never on the wire's
log = logging.getLogger(__name__)


class TlogWriter:
    """Writes on its own thread; a full disk ends the log with one warning and leaves the flight alone."""

    def __init__(self, file: IO[bytes], name: str) -> None:
        self._file = file
        self._name = name
        self._queue: queue.Queue[bytes | None] = queue.Queue(_QUEUE_FRAMES)
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
        try:
            self._queue.put_nowait(_STAMP.pack(int(wall_s * 1e6)) + frame)
        except queue.Full:
            self.dropped += 1

    def close(self) -> None:
        """Write what is queued and close the file (blocks at most 2 s)."""
        try:
            self._queue.put(None, timeout=1.0)
        except queue.Full:
            return
        self._thread.join(1.0)

    def _run(self) -> None:
        while (record := self._queue.get()) is not None:
            if self._failed:
                self.dropped += 1
                continue
            try:
                self._file.write(record)
                if self._queue.empty():
                    self._file.flush()
            except OSError as error:
                self._fail(error)
        try:
            self._file.close()
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        self._failed = True
        self.dropped += 1
        log.warning("telemetry log %s ends here: %s", self._name, error.strerror)

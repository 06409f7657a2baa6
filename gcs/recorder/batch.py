"""A file of a flight's record, written by a thread of its own, so that a slow, full or vanished disk fails alone."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

import msgspec

Item = TypeVar("Item")

WRITE_S: Final = 0.2  # so often, many at once: waking up for each of hundreds a second costs more than they do
_LOOK_S: Final = 5.0
_MOST_AT_ONCE: Final = 64  # then the interpreter is let go, for a tick that may be waiting for it
_FULL_S: Final = 0.002

log = logging.getLogger(__name__)


class BatchWriter(Generic[Item]):
    """Takes items from any thread. A caller never waits for the disk: what does not fit is dropped and counted.

    A disk error, or the size limit, ends the file with one warning: `problem` says what and where, and what stands in
    the file are whole records. What was written is safe from the death of this program, and `gcs.recorder.sync` guards
    it from a power cut.
    """

    def __init__(
        self,
        path: Path,
        encode: Callable[[list[Item]], bytes],
        *,
        most: int,
        wait_when_full: bool = False,
        size_limit_bytes: int | None = None,
        open_file: Callable[[Path], Any] = lambda path: path.open("wb", buffering=0),
    ) -> None:
        """most: items that may wait. encode: called on the writer's thread. open_file: gives an unbuffered file.

        wait_when_full: for dry runs, where completeness matters and nobody is flying.
        """
        self.path = path
        self.dropped = 0
        self.problem: str | None = None
        self._encode = encode
        self._most = most
        self._wait_when_full = wait_when_full
        self._size_limit_bytes = size_limit_bytes
        self._open_file = open_file
        self._size_bytes = 0
        self._waiting: deque[Item] = deque()
        self._wake = threading.Event()
        self._ending = False
        self._thread = threading.Thread(target=self._run, name=path.name, daemon=True)
        self._thread.start()

    @property
    def trouble(self) -> str | None:
        """What is wrong with the record so far, in one line."""
        if self.problem is not None:
            return self.problem
        return f"{self.path}: records are missing, the disk or the processor is too slow" if self.dropped else None

    def put(self, item: Item) -> None:
        """Queue one."""
        while self._wait_when_full and len(self._waiting) >= self._most and self._thread.is_alive():
            self._wake.set()
            time.sleep(_FULL_S)
        if self.problem is not None or len(self._waiting) >= self._most:
            self.dropped += 1
        else:
            self._waiting.append(item)

    def close(self, timeout_s: float = 5.0) -> None:
        """Write what is left, for at most timeout_s."""
        self._ending = True
        self._wake.set()
        self._thread.join(timeout_s)
        if self._thread.is_alive() and self.problem is None:
            self._give_up("the disk does not answer")

    def _run(self) -> None:
        try:
            with self._open_file(self.path) as file:
                self._pump(file)
        except OSError as error:
            self._give_up(error.strerror or str(error))
        except (TypeError, ValueError, OverflowError, msgspec.MsgspecError) as error:
            # Something that cannot be encoded is a programming error, but not worth a flight.
            self._give_up(str(error))

    def _pump(self, file: Any) -> None:
        looked_s = time.monotonic()
        while not self._ending:
            self._wake.wait(WRITE_S)
            self._wake.clear()
            self._write(file)
            if time.monotonic() - looked_s > _LOOK_S:
                _check_there(file)
                looked_s = time.monotonic()
        self._write(file)

    def _write(self, file: Any) -> None:
        while self._waiting:
            items = [self._waiting.popleft() for _ in range(min(len(self._waiting), _MOST_AT_ONCE))]
            try:
                self._put_down(file, self._encode(items))
            except BaseException:
                self.dropped += len(items)
                with contextlib.suppress(OSError):
                    file.truncate(self._size_bytes)  # no half record
                raise

    def _put_down(self, file: Any, data: bytes) -> None:
        limit = self._size_limit_bytes
        if limit is not None and self._size_bytes + len(data) > limit:
            raise OSError(f"the size limit of {limit} bytes is reached")
        left = memoryview(data)
        while left:
            left = left[file.write(left) :]
        self._size_bytes += len(data)

    def _give_up(self, reason: str) -> None:
        self.problem = f"{self.path}: {reason[:1].lower()}{reason[1:]}"
        log.warning("the record ends here: %s", self.problem)
        self.dropped += len(self._waiting)
        self._waiting.clear()


def _check_there(file: Any) -> None:
    """OSError for a file that was deleted: writing to it does not fail."""
    with contextlib.suppress(io.UnsupportedOperation):
        if os.fstat(file.fileno()).st_nlink == 0:
            raise OSError("the file was deleted")

"""The log of every message between the stages, one JSON object per line, on a thread of its own.

A line is {"n": count, "t_s": time, "type": class name, "frame": seq or null, "data": {...}}. Floats are written
so that they read back bit for bit, which is what a replay needs.
"""

from __future__ import annotations

import logging
import os
import queue
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

QUEUE_LENGTH = 4096
FLUSH_S = 0.5  # a crash of the program loses at most this much

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Record:
    """One line as read back; `data` holds plain JSON values."""

    n: int
    t_s: float
    type: str
    frame: int | None
    data: Any


class MessageLog:
    """Takes frozen dataclasses from any thread and never makes the caller wait for the disk.

    wait_when_full: for dry runs, where completeness matters and nobody is flying; otherwise what does not fit
    in the queue is dropped and counted. A disk error ends the log with one warning, never the run; `problem`
    then says why.
    """

    def __init__(
        self,
        path: Path,
        *,
        wait_when_full: bool = False,
        size_limit_bytes: int | None = None,
        open_file: Callable[[Path], Any] = lambda path: path.open("wb"),
    ) -> None:
        self.path = path
        self.dropped = 0
        self.problem: str | None = None
        self._wait_when_full = wait_when_full
        self._size_limit_bytes = size_limit_bytes
        self._open_file = open_file
        self._encode = encoder().encode
        self._count = 0
        self._lock = threading.Lock()
        self._queue: queue.Queue[tuple[int, float, int | None, object] | None] = queue.Queue(QUEUE_LENGTH)
        self._thread = threading.Thread(target=self._run, name="messages", daemon=True)
        self._thread.start()

    def write(self, t_s: float, message: object, frame: int | None = None) -> None:
        """Log a frozen dataclass; t_s: the time of the event, frame: seq of the frame it came from."""
        with self._lock:
            item = (self._count, t_s, frame, message)
            self._count += 1
        if self._wait_when_full:
            self._queue.put(item)
            return
        try:
            self._queue.put_nowait(item)
        except queue.Full:
            self.dropped += 1

    def close(self, timeout_s: float = 5.0) -> None:
        """Write what is left, for at most timeout_s."""
        deadline_s = time.monotonic() + timeout_s
        try:
            self._queue.put(None, timeout=timeout_s)
        except queue.Full:
            return
        self._thread.join(max(0.0, deadline_s - time.monotonic()))

    def __enter__(self) -> MessageLog:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        try:
            with self._open_file(self.path) as file:
                self._pump(file)
        except OSError as error:
            self._give_up(error.strerror or str(error))
        except (TypeError, ValueError, msgspec.MsgspecError) as error:
            # A message that is no JSON is a programming error, but not worth a flight.
            self._give_up(str(error))
        if self.problem is not None:
            while self._queue.get() is not None:
                self.dropped += 1

    def _pump(self, file: Any) -> None:
        written = 0
        flushed_s = time.monotonic()
        while (item := self._next(file)) is not None:
            n, t_s, frame, message = item
            row = {"n": n, "t_s": t_s, "type": type(message).__name__, "frame": frame, "data": message}
            line = self._encode(row) + b"\n"
            written += len(line)
            if self._size_limit_bytes is not None and written > self._size_limit_bytes:
                raise OSError(f"the size limit of {self._size_limit_bytes} bytes is reached")
            file.write(line)
            if time.monotonic() - flushed_s > FLUSH_S:
                file.flush()
                flushed_s = time.monotonic()

    def _next(self, file: Any) -> tuple[int, float, int | None, object] | None:
        """The next message; flushes before it waits for a long time."""
        try:
            return self._queue.get(timeout=FLUSH_S)
        except queue.Empty:
            file.flush()
            return self._queue.get()

    def _give_up(self, reason: str) -> None:
        self.problem = f"{self.path}: {reason}"
        log.warning("message log stopped: %s", self.problem)


def encoder() -> msgspec.json.Encoder:
    """Of the log's lines; floats read back bit for bit, NaN and infinities as null."""
    return msgspec.json.Encoder(enc_hook=_plain)


def read_messages(path: str | os.PathLike[str]) -> Iterator[Record]:
    """The records of a log in order; a last line cut off by a crash is left out."""
    decoder = msgspec.json.Decoder(Record)
    with open(path, "rb") as file:
        for line in file:
            try:
                yield decoder.decode(line)
            except msgspec.DecodeError:
                if line.endswith(b"\n"):
                    raise
                return


def _plain(value: Any) -> Any:
    """What msgspec does not know: numpy's scalars and small arrays."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")

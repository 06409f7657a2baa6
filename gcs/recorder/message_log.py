"""The log of every message between the stages, one JSON object per line, on a thread of its own.

A line is {"n": count, "t_s": time, "type": class name, "frame": seq or null, "data": {...}}. Floats are written
so that they read back bit for bit, which is what a replay needs.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from gcs.recorder.batch import BatchWriter

QUEUE_LENGTH: Final = 8192  # half a minute of a disk that stands still


@dataclass(frozen=True, slots=True)
class Record:
    """One line; `data`, as read back, holds plain JSON values."""

    n: int
    t_s: float
    type: str
    frame: int | None
    data: Any


class MessageLog(BatchWriter[tuple[int, float, int | None, object]]):
    """Takes frozen dataclasses from any thread and never makes the caller wait for the disk."""

    def __init__(
        self,
        path: Path,
        *,
        wait_when_full: bool = False,
        size_limit_bytes: int | None = None,
        open_file: Callable[[Path], Any] = lambda path: path.open("wb", buffering=0),
    ) -> None:
        """As `BatchWriter`."""
        self._line = encoder().encode
        self._count = 0
        self._lock = threading.Lock()
        super().__init__(
            path, self._lines, most=QUEUE_LENGTH, wait_when_full=wait_when_full,
            size_limit_bytes=size_limit_bytes, open_file=open_file,
        )  # fmt: skip

    def write(self, t_s: float, message: object, frame: int | None = None) -> None:
        """Log a frozen dataclass; t_s: the time of the event, frame: seq of the frame it came from."""
        with self._lock:
            self.put((self._count, t_s, frame, message))
            self._count += 1

    def _lines(self, items: list[tuple[int, float, int | None, object]]) -> bytes:
        rows = (Record(n, t_s, type(message).__name__, frame, message) for n, t_s, frame, message in items)
        return b"".join([self._line(row) + b"\n" for row in rows])

    def __enter__(self) -> MessageLog:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


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

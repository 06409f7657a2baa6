"""The files of a film on the disk, in an order that leaves them readable wherever the writing stops."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import IO, Final

import msgspec

from gcs.recorder.film_index import INDEX, PacketRow, StreamRow, film_name, stream_row
from gcs.video.tap import Coding

_MOST_HELD_BYTES: Final = 4 * 1024 * 1024


class FilmFiles:
    """Blocking, for one thread; OSError where the disk fails. Nothing is made before the first packet."""

    def __init__(self, folder: Path, open_file: Callable[[Path], IO[bytes]]) -> None:
        self._folder, self._open_file = folder, open_file
        self._index: IO[bytes] | None = None
        self._files: dict[str, IO[bytes]] = {}  # by codec
        self._ends: dict[str, int] = {}
        self._coding: Coding | None = None
        self._lossy = self._is_told = False
        self._lines: list[bytes] = []  # of packets that are not on the disk for certain
        self._held_bytes = 0

    def __enter__(self) -> FilmFiles:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        for file in self._all():
            if kind is None:
                file.close()
            else:  # a full disk says so again
                with contextlib.suppress(OSError):
                    file.close()

    def begin(self, coding: Coding, *, lossy: bool) -> None:
        """Of what comes next; told with its first packet."""
        self._coding, self._lossy, self._is_told = coding, lossy, False

    def add(self, number: int, data: bytes, t_arrival_s: float, *, is_key: bool, skips: bool) -> None:
        """A packet of the connection begun last."""
        assert self._coding is not None
        codec = self._coding.codec
        file = self._opened(codec)
        if not self._is_told:
            self._is_told = True
            name = film_name(codec, 1 + list(self._files).index(codec))
            self._tell(stream_row(name, self._coding, lossy=self._lossy))
            # Where the parameters came beside the stream, a player would look for them in vain.
            self._ends[codec] += file.write(self._coding.extradata)
        row = PacketRow(number, self._ends[codec], len(data), t_arrival_s, is_key, skips)
        self._ends[codec] += file.write(data)
        self._tell(row)
        self._held_bytes += len(data)
        if self._held_bytes > _MOST_HELD_BYTES:
            self.flush()

    def flush(self) -> None:
        """After this a program that dies leaves all of it; the index never tells of bytes that are not there."""
        for file in self._files.values():
            file.flush()
        if self._index is not None:
            self._index.write(b"".join(self._lines))
            self._index.flush()
        self._lines.clear()
        self._held_bytes = 0

    def sync(self) -> None:
        """After this a power cut leaves all of it."""
        self.flush()
        for file in self._all():
            os.fsync(file.fileno())

    def _opened(self, codec: str) -> IO[bytes]:
        if self._index is None:
            self._index = self._open_file(self._folder / INDEX)
        if codec not in self._files:
            self._files[codec] = self._open_file(self._folder / film_name(codec, len(self._files) + 1))
            self._ends[codec] = 0
        return self._files[codec]

    def _tell(self, row: StreamRow | PacketRow) -> None:
        self._lines.append(msgspec.json.encode(row) + b"\n")

    def _all(self) -> list[IO[bytes]]:
        return [*self._files.values(), *([] if self._index is None else [self._index])]

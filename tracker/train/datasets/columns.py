"""Sequences kept as a few arrays instead of millions of objects: forked workers share them, a file holds them."""

from __future__ import annotations

import logging
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from itertools import accumulate
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np

from tracker.train.pack import BrokenPictureError, Pyramid, Thing, pyramid_of

T = TypeVar("T")
CACHED_PICTURES = 32  # per process: a sample asks for the same few pictures many times (some 4 MB each at 720p)
log = logging.getLogger(__name__)


def read_picture(path: Path) -> np.ndarray:
    """The picture (H,W,3) uint8 BGR as it is stored: boxes count stored pixels, so no turning by EXIF.

    Raises BrokenPictureError naming the file and why.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BrokenPictureError(f"{path}: {error.strerror or error}") from error
    if data[:2] == b"\xff\xd8" and data.find(b"\xff\xd9", len(data) // 2) < 0:  # decoded, the rest would be grey
        raise BrokenPictureError(f"{path}: the picture is cut short")
    try:
        flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    except cv2.error as error:  # larger than OpenCV may decode
        raise BrokenPictureError(f"{path}: cannot be decoded ({str(error).splitlines()[0]})") from error
    if image is None:
        raise BrokenPictureError(f"{path}: cannot be decoded")
    if min(image.shape[:2]) < 4:
        raise BrokenPictureError(f"{path}: only {image.shape[1]} x {image.shape[0]} px")
    return image


class PictureFiles(Sequence[Pyramid]):
    """Pictures read from the disc when asked for, the last few kept by each process for itself.

    folders: paths (F). folder: index into them (N,) int32. names: file names (N,) bytes.
    A file that cannot be read raises BrokenPictureError, and is named once in the log.
    """

    def __init__(self, folders: Sequence[str], folder: np.ndarray, names: np.ndarray) -> None:
        self.folders, self.folder, self.names = list(folders), folder, names
        self._broken: dict[int, str] = {}
        self._recent = lru_cache(CACHED_PICTURES)(self._read)  # a forked child goes on with its own copy

    def __reduce__(self) -> tuple[Any, ...]:
        return PictureFiles, (self.folders, self.folder, self.names)

    def __len__(self) -> int:
        return len(self.names)

    def path(self, i: int) -> Path:
        """Where the picture lies."""
        return Path(self.folders[self.folder[i]], self.names[i].decode())

    def __getitem__(self, i: int) -> Pyramid:
        if i in self._broken:
            raise BrokenPictureError(self._broken[i])
        try:
            return self._recent(int(i))
        except BrokenPictureError as error:
            self._broken[i] = str(error)
            log.warning("left out of training: %s", error)
            raise

    def _read(self, i: int) -> Pyramid:
        return pyramid_of(read_picture(self.path(i)))


class Ragged(Sequence[list[int]]):
    """Lists of integers of any length: list i is flat[starts[i]:starts[i+1]] + shift."""

    def __init__(self, flat: np.ndarray, starts: np.ndarray, shift: int = 0) -> None:
        self.flat, self.starts, self.shift = flat, starts, shift

    def __len__(self) -> int:
        return len(self.starts) - 1

    def __getitem__(self, i: int) -> list[int]:
        if not 0 <= i < len(self):
            raise IndexError(i)
        return (self.flat[self.starts[i] : self.starts[i + 1]] + self.shift).tolist()


class ThingColumns(Sequence[Thing]):
    """Annotated objects as arrays; `shift` is added to the numbers of their pictures."""

    def __init__(self, index: Any, shift: int) -> None:
        self.index, self.shift = index, shift

    def __len__(self) -> int:
        return len(self.index.image)

    def __getitem__(self, i: int) -> Thing:
        if not 0 <= i < len(self):
            raise IndexError(i)
        index = self.index
        first, last = index.outline_starts[i : i + 2]
        polygons = tuple(
            index.points[index.polygon_starts[k] : index.polygon_starts[k + 1]] for k in range(first, last)
        )
        x, y, w, h = index.box[i].tolist()
        return Thing(int(index.image[i]) + self.shift, (x, y, w, h), polygons, -1, self.label(i))

    def label(self, i: int) -> str:
        """What the thing is called."""
        return str(self.index.labels[self.index.label[i]])

    def outlined(self) -> np.ndarray:
        """Indices of those with polygons."""
        return np.flatnonzero(np.diff(self.index.outline_starts))


class Joined(Sequence[T]):
    """Several sequences behind one another, none of them copied."""

    def __init__(self, pieces: Sequence[Sequence[T]]) -> None:
        self.pieces = list(pieces)
        self.starts = [0, *accumulate(len(p) for p in self.pieces)]

    def __len__(self) -> int:
        return self.starts[-1]

    def place(self, i: int) -> tuple[int, int]:
        """Which piece item i is in, and its place there; raises IndexError."""
        i = int(i)
        if not 0 <= i < len(self):
            raise IndexError(i)
        k = bisect_right(self.starts, i) - 1
        return k, i - self.starts[k]

    def __getitem__(self, i: int) -> T:
        k, at = self.place(i)
        return self.pieces[k][at]

    def __iter__(self) -> Iterator[T]:
        for piece in self.pieces:
            yield from piece

    def each(self, indices: Callable[[Sequence[T]], Sequence[int]]) -> list[int]:
        """Indices found in each piece, as indices of the whole."""
        return [int(i) + start for piece, start in zip(self.pieces, self.starts, strict=False) for i in indices(piece)]

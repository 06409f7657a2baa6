"""What a big data set holds, as arrays: where its pictures lie, their objects, tracks and clips; kept in a cache."""

from __future__ import annotations

import hashlib
import logging
import os
import zipfile
from array import array
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from tracker.train.pack import MIN_OBJECT_PX

FORMAT = 1  # of the cached file; raised with every change of what readers take from a set
MAX_AREA_FRAC = 0.95  # of its picture: an object that fills it has no surroundings to be found in
log = logging.getLogger(__name__)


class DatasetError(ValueError):
    """A data set to train on is not as published; the message names the file and what is wrong."""


@dataclass(frozen=True)
class Index:
    """A data set's subset: N pictures, T things with Q polygons of P points, tracks and clips as flat lists.

    folders (F,) str, folder (N,) and frame (N,) int32, names (N,) bytes; image (T,) int32, box (T,4) float32
    x, y, w, h px with 0-based corners, label (T,) int32 into labels (L,) str; points (P,2) float32 px,
    polygon_starts (Q+1,), outline_starts (T+1,); track and clip int32 with their starts.
    """

    folders: np.ndarray
    folder: np.ndarray
    names: np.ndarray
    frame: np.ndarray
    image: np.ndarray
    box: np.ndarray
    label: np.ndarray
    labels: np.ndarray
    points: np.ndarray
    polygon_starts: np.ndarray
    outline_starts: np.ndarray
    track: np.ndarray
    track_starts: np.ndarray
    clip: np.ndarray
    clip_starts: np.ndarray


class IndexWriter:
    """Collects pictures, things, tracks and clips into an Index, without an object for each."""

    def __init__(self) -> None:
        self._folders: dict[str, int] = {}
        self._labels: dict[str, int] = {}
        self._names: list[bytes] = []
        self._folder, self._frame = array("i"), array("i")
        self._image, self._label, self._box = array("i"), array("i"), array("f")
        self._points, self._polygons, self._outlines = array("f"), array("q", [0]), array("q", [0])
        self._track, self._tracks = array("i"), array("q", [0])
        self._clip, self._clips = array("i"), array("q", [0])

    def picture(self, folder: Path | str, name: str, frame: int = -1) -> int:
        """Note a picture (frame: its number in its video, -1 for a still); returns its index."""
        self._folder.append(self._folders.setdefault(str(folder), len(self._folders)))
        self._names.append(name.encode())
        self._frame.append(frame)
        return len(self._names) - 1

    def thing(
        self,
        image: int,
        box: Sequence[float],
        label: str,
        size: tuple[float, float] | None = None,
        polygons: Iterable[Sequence[float]] = (),
    ) -> int | None:
        """Note an object (x, y, w, h px in a picture of size w, h px); its index, None where it is of no use."""
        w, h = box[2], box[3]
        if not min(w, h) >= MIN_OBJECT_PX or (size and w * h > MAX_AREA_FRAC * size[0] * size[1]):
            return None
        self._image.append(image)
        self._box.extend(box)
        self._label.append(self._labels.setdefault(label, len(self._labels)))
        for polygon in polygons:
            self._points.extend(polygon)
            self._polygons.append(len(self._points) // 2)
        self._outlines.append(len(self._polygons) - 1)
        return len(self._image) - 1

    def track(self, things: Sequence[int]) -> None:
        """Note one object's things in order of frames; a single one is no track."""
        if len(things) > 1:
            self._track.extend(things)
            self._tracks.append(len(self._track))

    def clip(self, images: Sequence[int]) -> None:
        """Note one clip's pictures in order of frames; a single one is no clip."""
        if len(images) > 1:
            self._clip.extend(images)
            self._clips.append(len(self._clip))

    def finish(self) -> Index:
        """The arrays."""
        return Index(
            folders=np.array(list(self._folders), np.str_),
            folder=np.array(self._folder),
            names=np.array(self._names, np.bytes_),
            frame=np.array(self._frame),
            image=np.array(self._image),
            box=np.array(self._box).reshape(-1, 4),
            label=np.array(self._label),
            labels=np.array(list(self._labels), np.str_),
            points=np.array(self._points).reshape(-1, 2),
            polygon_starts=np.array(self._polygons),
            outline_starts=np.array(self._outlines),
            track=np.array(self._track),
            track_starts=np.array(self._tracks),
            clip=np.array(self._clip),
            clip_starts=np.array(self._clips),
        )


def cache_folder() -> Path:
    """The user's cache folder (XDG base directory specification)."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "climrt" / "datasets"


def signature(*parts: object, files: Iterable[Path] = ()) -> str:
    """A name for an index of these files as they are now: by path, time of change and size."""
    digest = hashlib.sha256(repr((FORMAT, MIN_OBJECT_PX, *parts)).encode())
    for file in files:
        state = file.stat()
        digest.update(f"{file.resolve()} {state.st_mtime_ns} {state.st_size}".encode())
    return digest.hexdigest()[:24]


def cached(folder: Path, name: str, build: Callable[[], Index]) -> Index:
    """The index of that name from the folder, else built and written there (if the folder can be written to)."""
    path = folder / f"{name}.npz"
    try:
        with np.load(path) as found:
            return Index(**{f.name: found[f.name] for f in fields(Index)})
    except FileNotFoundError:
        pass
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        log.warning("%s: index built anew (%s)", path, error)
    index = build()
    part = path.with_suffix(f".{os.getpid()}.part")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as file:
            np.savez(file, **{f.name: getattr(index, f.name) for f in fields(Index)})
        part.replace(path)
    except OSError as error:
        log.warning("%s: index not kept (%s)", path, error.strerror or error)
    return index

"""Imagery to train on, and its packs of stills and clips (a tar or a folder with a pack.json) held in memory."""

from __future__ import annotations

import io
import json
import tarfile
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np

MIN_OBJECT_PX = 10  # smaller boxes carry too little to learn a template from
BROKEN_IN_A_ROW = 50  # draws with a picture that cannot be read: the disc is gone, not a file
PACK_REACH = 20  # frames: further apart in a pack's clip, an object has often turned into another picture of itself

T = TypeVar("T")
Pyramid = tuple[np.ndarray, ...]  # one picture at full, half and quarter size, (H,W,3) uint8 BGR


class BrokenPictureError(ValueError):
    """A picture of a big data set cannot be read; the message names the file and what is wrong with it."""


def unbroken(draw: Callable[[], T]) -> T:
    """What draw() gives, or gives next where a picture is broken (its reader has named it).

    Raises BrokenPictureError when one follows another, BROKEN_IN_A_ROW times.
    """
    for _ in range(BROKEN_IN_A_ROW - 1):
        with suppress(BrokenPictureError):
            return draw()
    return draw()


@dataclass(frozen=True, slots=True)
class Thing:
    """One annotated object: which image, its box (x, y, w, h) px, and its outline if there is one."""

    image: int
    box: tuple[float, float, float, float]
    outline: tuple[np.ndarray, ...] = ()  # polygons (N,2) px
    mask_of: int = -1  # index into Imagery.masks, -1 = none
    label: str = ""


@dataclass
class Imagery:
    """All pictures as uint8 BGR, with the objects on them and the tracks through clips.

    Here everything is in memory; tracker.train.datasets.JoinedImagery reads big sets' pictures from the disc when
    asked for them, and then `pyramids[i]` raises BrokenPictureError for a file that cannot be read.
    """

    pyramids: Sequence[Pyramid] = field(default_factory=list)
    masks: Sequence[np.ndarray] = field(default_factory=list)
    parts: Sequence[str] = field(default_factory=list)
    frames: Sequence[int] = field(default_factory=list)  # number in the clip's video, -1 for a still
    things: Sequence[Thing] = field(default_factory=list)
    tracks: Sequence[list[int]] = field(default_factory=list)  # indices of things, in order of frames
    clips: Sequence[list[int]] = field(default_factory=list)  # indices of images, in order of frames

    def __len__(self) -> int:
        return len(self.pyramids)

    @property
    def in_memory(self) -> bool:
        """Whether every picture is held in memory, as it must be to be copied to a device whole."""
        return True

    def reach(self, track: int) -> int:
        """How many places of the track the template and the search frame may lie apart."""
        return PACK_REACH

    def outlined(self) -> list[int]:
        """Indices of the things that have a mask or outline, so that they can be cut out."""
        return [i for i, t in enumerate(self.things) if t.outline or t.mask_of >= 0]

    def label(self, thing: int) -> str:
        """What the thing is called, "" where nobody said."""
        return self.things[thing].label

    def part_counts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Names of the parts that have things (P,), each thing's part as index into them (T,), things per part (P,)."""
        parts = [self.parts[t.image] for t in self.things]
        return np.unique(parts, return_inverse=True, return_counts=True)


def _reader(source: Path) -> tuple[list[dict], Callable[[str], bytes]]:
    """The pack's list of records, and a function that reads one of its files."""
    if source.is_dir():
        return json.loads((source / "pack.json").read_text()), lambda name: (source / name).read_bytes()
    blob = source.read_bytes()
    with tarfile.open(fileobj=io.BytesIO(blob)) as tar:
        where = {Path(m.name).name: (m.offset_data, m.size) for m in tar.getmembers() if m.isfile()}

    def read(name: str) -> bytes:
        start, size = where[name]
        return blob[start : start + size]

    return json.loads(read("pack.json")), read


def _decode(data: bytes, flag: int = cv2.IMREAD_COLOR) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), flag)
    if image is None:
        raise ValueError("a picture of the pack cannot be decoded")
    return image


def pyramid_of(image: np.ndarray) -> Pyramid:
    """The image at full, half and quarter size: shrinking from the nearest level avoids aliasing."""
    half = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    return image, half, cv2.resize(half, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)


def _things_of(record: dict, image: int, mask: int) -> Iterator[tuple[Thing, object]]:
    """The usable objects of one record, each with its track id (None outside clips)."""
    boxes = record.get("boxes") or []
    outlines = record.get("segs") or [[] for _ in boxes]
    labels = record.get("classes") or ([record["label"]] * len(boxes) if "label" in record else [""] * len(boxes))
    tids = record.get("tids") or [None] * len(boxes)
    for box, outline, label, tid in zip(boxes, outlines, labels, tids, strict=False):
        x, y, w, h = box
        if min(w, h) < MIN_OBJECT_PX or w * h > 0.95 * record["w"] * record["h"]:
            continue
        polygons = tuple(np.asarray(p, np.float32).reshape(-1, 2) for p in outline if len(p) >= 6)
        yield (
            Thing(image, (x, y, w, h), polygons, mask, str(label)),
            tid if tid is not None else ("only" if mask >= 0 else None),
        )


def load(sources: list[Path], split: str = "train", only: set[str] | None = None) -> Imagery:
    """Decode every record of the split from the packs.

    sources: tar files or folders with pack.json. split: 'train' or 'val' as the records say.
    Raises FileNotFoundError for a missing pack, ValueError for a broken picture.
    """
    found = Imagery()
    tracks: dict[tuple[str, object], list[tuple[int, int]]] = defaultdict(list)
    clips: dict[str, list[tuple[int, int]]] = defaultdict(list)
    with ThreadPoolExecutor(2) as pool:
        for source in sources:
            records, read = _reader(source)
            records = [r for r in records if r["split"] == split and (only is None or r["part"] in only)]
            decoded = pool.map(lambda r, read=read: _decode(read(r["f"])), records)
            for record, image in zip(records, decoded, strict=True):
                index = len(found.pyramids)
                found.pyramids.append(pyramid_of(image))
                found.parts.append(record["part"])
                found.frames.append(record.get("frame", 0) if record.get("clip") else -1)
                mask = -1
                if "mask" in record:
                    mask = len(found.masks)
                    found.masks.append(_decode(read(record["mask"]), cv2.IMREAD_GRAYSCALE))
                clip = record.get("clip")
                if clip:
                    clips[clip].append((record.get("frame", 0), index))
                for thing, tid in _things_of(record, index, mask):
                    if clip and tid is not None:
                        tracks[(clip, tid)].append((record.get("frame", 0), len(found.things)))
                    found.things.append(thing)
    found.tracks = [[i for _, i in sorted(t)] for t in tracks.values() if len(t) > 1]
    found.clips = [[i for _, i in sorted(c)] for c in clips.values() if len(c) > 1]
    return found

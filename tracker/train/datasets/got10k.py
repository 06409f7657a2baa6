"""GOT-10k: ten thousand clips, one object of any of 563 classes followed through each.

Layout (http://got-10k.aitestunion.com/downloads, reader https://github.com/got-10k/toolkit): train/list.txt names the
folders; train/GOT-10k_Train_000001/00000001.jpg …, groundtruth.txt (x, y, w, h a frame, 0-based corner, fractions
included), absence.label (1 = the object is not in the frame), cover.label (visible share, 0 = nothing … 8 = all of
it), meta_info.ini (object_class, resolution). Frames where it is absent or wholly covered give no thing. Frames are
10 a second. Licence: CC BY-NC-SA 4.0, not commercial.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

from tracker.train.datasets.files import in_order, need_file, need_folder, read_lines, spread
from tracker.train.datasets.index import DatasetError, Index, IndexWriter

TRAIN, VAL = "train", "val"
REACH = 50  # frames between template and search, as the paper trains

Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Clip:
    """A sequence: its pictures' names, the box in each (None: not to be seen), class, and size px if it is told."""

    names: list[str]
    boxes: list[Box | None]
    label: str
    size: tuple[float, float] | None


def clips_of(root: Path, subset: str) -> list[Path]:
    """The folders that list.txt names."""
    top = need_folder(need_folder(root, "root of GOT-10k") / subset, "a subset of GOT-10k")
    names = read_lines(top / "list.txt", "GOT-10k's list of sequences")
    return [need_folder(top / name, "a sequence of GOT-10k's list") for name in names]


def sources(root: Path, subset: str) -> list[Path]:
    """What the index is made from."""
    boxes = [clip / "groundtruth.txt" for clip in clips_of(root, subset)]
    return [root / subset / "list.txt", *(need_file(path, "GOT-10k's boxes") for path in boxes)]


def read(root: Path, subset: str, limit: int | None) -> Index:
    """Index `limit` clips; raises DatasetError naming the file and what is wrong in it."""
    clips = spread(clips_of(root, subset), limit)
    index = IndexWriter()
    for folder, clip in zip(clips, in_order(clip_of, clips, f"GOT-10k {subset}"), strict=True):
        images = [index.picture(folder, name, frame) for frame, name in enumerate(clip.names)]
        things = [
            index.thing(image, box, clip.label, clip.size)
            for image, box in zip(images, clip.boxes, strict=True)
            if box is not None
        ]
        index.clip(images)
        index.track([i for i in things if i is not None])
    return index.finish()


def clip_of(folder: Path) -> Clip:
    """One sequence's files; raises DatasetError."""
    path = folder / "groundtruth.txt"
    boxes = [_box(path, k, line) for k, line in enumerate(read_lines(path, "GOT-10k's boxes"), 1)]
    names = sorted(p.name for p in folder.glob("*.jpg"))
    if len(names) != len(boxes):
        raise DatasetError(f"{path}: {len(boxes)} boxes for {len(names)} pictures")
    absent = _levels(folder / "absence.label", len(boxes), default=0)
    cover = _levels(folder / "cover.label", len(boxes), default=8)
    seen = [box if not a and c > 0 else None for box, a, c in zip(boxes, absent, cover, strict=True)]
    meta = folder / "meta_info.ini"
    text = meta.read_text(errors="replace") if meta.is_file() else ""
    label = re.search(r"^object_class:[ \t]*(.+?)\s*$", text, re.MULTILINE)
    size = re.search(r"^resolution:\s*\(?(\d+)\s*,\s*(\d+)", text, re.MULTILINE)
    return Clip(
        names, seen, label.group(1) if label else "", (float(size.group(1)), float(size.group(2))) if size else None
    )


def _box(path: Path, number: int, line: str) -> Box:
    try:
        x, y, w, h = (float(v) for v in line.split(","))
    except ValueError as error:
        raise DatasetError(f"{path}: line {number}: {line!r} is not x,y,w,h") from error
    if not all(math.isfinite(v) for v in (x, y, w, h)):
        raise DatasetError(f"{path}: line {number}: {line!r} is not a box")
    return x, y, w, h


def _levels(path: Path, count: int, default: int) -> list[int]:
    """A number a frame; the default for each where the subset comes without the file."""
    if not path.exists():
        return [default] * count
    lines = read_lines(path, "GOT-10k's labels")
    if len(lines) != count:
        raise DatasetError(f"{path}: {len(lines)} lines for {count} boxes")
    try:
        return [int(line) for line in lines]
    except ValueError as error:
        raise DatasetError(f"{path}: {error}") from error

"""COCO 2017: stills with boxes and outlines of objects of 80 classes.

Layout (https://cocodataset.org/#download, fields https://cocodataset.org/#format-data):
annotations/instances_train2017.json, train2017/000000000009.jpg; the same for val2017.
Boxes are x, y, w, h with 0-based corners, fractions of pixels included. Objects are outlined by polygons; regions
with iscrowd=1 (run lengths) are many objects in one box and are left out. Other sets in this format may have
uncompressed run lengths for single objects too: these become polygons. Annotations: CC BY 4.0; the pictures belong
to their authors (Flickr).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import msgspec
import numpy as np
from tqdm import tqdm

from tracker.train.datasets.files import need_file, need_folder, spread
from tracker.train.datasets.index import DatasetError, Index, IndexWriter

TRAIN, VAL = "train2017", "val2017"
REACH = 1  # the pair is made from one picture: nothing moves


class RunLengths(msgspec.Struct):
    """Mask as lengths of runs of 0 and 1 in turn, down the columns; size is (height, width)."""

    size: tuple[int, int]
    counts: list[int]


class Picture(msgspec.Struct):
    """One entry of `images`."""

    id: int
    file_name: str
    width: int
    height: int


class Annotation(msgspec.Struct):
    """One entry of `annotations`; the outline stays text until it is wanted."""

    image_id: int
    category_id: int
    bbox: tuple[float, float, float, float]
    iscrowd: int = 0
    segmentation: msgspec.Raw = msgspec.Raw(b"[]")


class Category(msgspec.Struct):
    """One entry of `categories`."""

    id: int
    name: str


class Instances(msgspec.Struct):
    """An instances_*.json."""

    images: list[Picture]
    annotations: list[Annotation]
    categories: list[Category]


def sources(root: Path, subset: str) -> list[Path]:
    """The files that the index is made from."""
    need_folder(root, "root of COCO")
    need_folder(root / subset, "COCO's pictures")
    return [need_file(root / "annotations" / f"instances_{subset}.json", "COCO's annotations")]


def read(root: Path, subset: str, limit: int | None) -> Index:
    """Index `limit` pictures with their objects; raises DatasetError naming the file and the entry."""
    (path,) = sources(root, subset)
    try:
        found = msgspec.json.decode(path.read_bytes(), type=Instances)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise DatasetError(f"{path}: {error}") from error
    names = {c.id: c.name for c in found.categories}
    known = {p.id: p for p in found.images}
    index = IndexWriter()
    chosen = {p.id: index.picture(root / subset, p.file_name) for p in spread(found.images, limit)}
    for k, a in enumerate(tqdm(found.annotations, desc=f"COCO {subset}", delay=2, leave=False, dynamic_ncols=True)):
        picture = known.get(a.image_id)
        if picture is None:
            raise DatasetError(f"{path}: annotation {k} is of image {a.image_id}, which the file does not list")
        if a.category_id not in names:
            raise DatasetError(f"{path}: annotation {k} is of category {a.category_id}, which the file does not list")
        if a.iscrowd or a.image_id not in chosen:
            continue
        try:
            outline = polygons(a.segmentation)
        except (msgspec.DecodeError, ValueError) as error:
            raise DatasetError(f"{path}: annotation {k}: segmentation: {error}") from error
        size = (picture.width, picture.height)
        index.thing(chosen[a.image_id], a.bbox, names[a.category_id], size, outline)
    return index.finish()


def polygons(segmentation: msgspec.Raw) -> list[Sequence[float]]:
    """The outline as flat x, y, x, y, … lists; raises ValueError for run lengths that do not fill the picture."""
    value = msgspec.json.decode(segmentation, type=list[list[float]] | RunLengths)
    if isinstance(value, RunLengths):
        return outlines_of(value)
    if any(len(p) % 2 for p in value):
        raise ValueError("a polygon has an x without its y")
    return [p for p in value if len(p) >= 6]


def outlines_of(runs: RunLengths) -> list[Sequence[float]]:
    """The outer contours of a run-length mask."""
    height, width = runs.size
    if min(runs.counts, default=0) < 0 or sum(runs.counts) != height * width:
        raise ValueError(f"run lengths of {sum(runs.counts)} px for a picture of {width} x {height}")
    values = np.arange(len(runs.counts), dtype=np.uint8) % 2
    mask = np.repeat(values, runs.counts).reshape(width, height).T
    contours, _ = cv2.findContours(np.ascontiguousarray(mask), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return [c.reshape(-1).tolist() for c in contours if len(c) >= 3]

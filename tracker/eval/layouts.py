"""Readers of the published layouts. Each returns entries that are read one by one, so that one may be broken."""

from __future__ import annotations

import configparser
import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.eval.attributes import OTB_ORDER, UAV123_ORDER, UAVTRACK112_ORDER, read_attributes
from tracker.eval.sequences import DEFAULT_FPS, VIDEOS, Sequence, SequenceError, picture_files, read_boxes, video_fps

# First frames, at 30 frames a second, of the parts into which UAV123 cuts longer recordings (its configSeqs.m);
# all others begin with picture 1. At 10 frames a second every third picture was kept.
UAV123_STARTS = {
    **{"bird1_2": 775, "bird1_3": 1573, "car1_2": 751, "car1_3": 1627, "car16_2": 415, "car6_2": 487, "car6_3": 1807},
    **{"car6_4": 2953, "car6_5": 3925, "car8_2": 1357, "group1_2": 1333, "group1_3": 2515, "group1_4": 3925},
    **{"group2_2": 907, "group2_3": 1771, "group3_2": 1567, "group3_3": 2827, "group3_4": 4369, "person12_2": 601},
    **{"person14_2": 847, "person14_3": 1813, "person17_2": 1501, "person19_2": 1243, "person19_3": 2791},
    **{"person2_2": 1189, "person4_2": 1501, "person5_2": 877, "person7_2": 1249, "person8_2": 1075},
    **{"truck4_2": 577, "uav1_2": 1555, "uav1_3": 2473},
}
# OTB's own remarks: David begins with picture 300; the first five boxes of Tiger1 are not to be used.
OTB_FIRST_NUMBER = {"David": 300}
OTB_OMITTED = {"Tiger1": 5}
BOX_FILES = ("groundtruth_rect.txt", "groundtruth.txt", "boxes.txt", "gt.txt")


@dataclass(frozen=True, slots=True)
class Entry:
    """A sequence that has been found but not yet read."""

    name: str
    read: Callable[[], Sequence]


def index(root: Path) -> list[Entry]:
    """A folder with index.json: [{name, video, boxes, fps, attributes}, ...]."""
    path = root / "index.json"
    try:
        rows = [(str(row["name"]), row) for row in json.loads(path.read_text(encoding="utf-8"))]
    except (ValueError, TypeError, KeyError) as error:
        raise SequenceError(f"{path}: not a list of sequences: {error!r}") from None

    def entry(name: str, row: dict[str, object]) -> Entry:
        def read() -> Sequence:
            try:
                video, boxes, fps = str(row["video"]), str(row["boxes"]), float(str(row.get("fps", 10)))
            except (KeyError, ValueError) as error:
                raise SequenceError(f"{path}: {name}: {error!r} is missing or no number") from None
            marks = row.get("attributes")
            attributes = tuple(str(mark) for mark in marks) if isinstance(marks, list) else None
            return Sequence(name, root / video, read_boxes(root / boxes), fps, attributes=attributes)

        return Entry(name, read)

    return [entry(name, row) for name, row in rows]


def uav(root: Path, subset: str, fps: float) -> list[Entry]:
    """UAV123, UAV123@10fps, UAV20L: data_seq[/SUBSET]/FOLDER/%06d.jpg, anno[/SUBSET]/NAME.txt, anno[/SUBSET]/att."""
    anno = _subset(root / "anno", subset)
    pictures = _subset(root / "data_seq", "UAV123" if subset == "UAV20L" else subset)

    def entry(file: Path) -> Entry:
        def read() -> Sequence:
            name = file.stem
            start = 1 if subset == "UAV20L" else UAV123_STARTS.get(name, 1)
            first = start if fps > 10 else (start - 1) // 3 + 1
            attributes = read_attributes([anno / "att", root / "att"], name, UAV123_ORDER)
            folder = _recording(pictures, name)
            return Sequence(name, folder, read_boxes(file), fps, first, is_part=True, attributes=attributes)

        return Entry(file.stem, read)

    return [entry(file) for file in sorted(anno.glob("*.txt"))]


def is_10fps(root: Path) -> bool:
    """Whether a UAV123 folder is the 10 fps edition: by its name, or by how many boxes a part has."""
    if "10fps" in root.name.lower() or any((root / kind / "UAV123_10fps").is_dir() for kind in ("anno", "data_seq")):
        return True
    anno = _subset(root / "anno", "UAV123")
    first, second = anno / "bird1_1.txt", anno / "car6_1.txt"
    known = next((file for file in (first, second) if file.is_file()), None)
    return known is not None and len(known.read_text().split()) < {"bird1_1": 253, "car6_1": 487}[known.stem]


def uavtrack112(root: Path, *, long: bool) -> list[Entry]:
    """UAVTrack112 and its long-term part: data_seq/NAME/*.jpg, anno(_l)/NAME.txt, att(_l)/NAME.txt."""
    anno = root / "anno_l" if long and (root / "anno_l").is_dir() else root / "anno"
    marks = [root / "att_l", root / "att", anno / "att"] if long else [root / "att", anno / "att"]

    def entry(file: Path) -> Entry:
        def read() -> Sequence:
            attributes = read_attributes(marks, file.stem, UAVTRACK112_ORDER)
            folder = _recording(root / "data_seq", file.stem)
            return Sequence(file.stem, folder, read_boxes(file), 30.0, is_part=True, attributes=attributes)

        return Entry(file.stem, read)

    return [entry(file) for file in sorted(anno.glob("*.txt"))]


def groundtruth_rect(root: Path) -> list[Entry]:
    """OTB and DTB70: NAME/img/*.jpg, NAME/groundtruth_rect.txt; of several targets groundtruth_rect.N.txt (NAME-N)."""

    def entry(file: Path) -> Entry:
        target = re.fullmatch(r"groundtruth_rect\.?(\d+)\.txt", file.name)
        folder = file.parent
        name = f"{folder.name}-{target[1]}" if target else folder.name

        def read() -> Sequence:
            omitted = OTB_OMITTED.get(name, 0)
            first = OTB_FIRST_NUMBER.get(name, 1 + omitted if omitted else None)
            attributes = read_attributes([root / "anno" / "att", root / "att"], name, OTB_ORDER)
            pictures = folder / "img" if (folder / "img").is_dir() else folder
            truth = read_boxes(file)[omitted:]
            return Sequence(name, pictures, truth, 30.0, first, is_part=True, attributes=attributes, omitted=omitted)

        return Entry(name, read)

    # OTB's Human4 has an empty file beside the one that counts.
    return [entry(file) for file in sorted(root.glob("*/groundtruth_rect*.txt")) if file.read_text().strip()]


def got10k_root(path: Path) -> Path | None:
    """The folder of GOT-10k that holds list.txt and the sequences: the one given, or val in it."""
    return next((p for p in (path, path / "val") if (p / "list.txt").is_file()), None)


def got10k(path: Path) -> list[Entry]:
    """GOT-10k: list.txt, NAME/%08d.jpg, NAME/groundtruth.txt, cover.label (0: out of sight), meta_info.ini."""
    root = got10k_root(path)
    if root is None:
        raise SequenceError(f"{path}: no list.txt, and none in val")

    def entry(name: str) -> Entry:
        def read() -> Sequence:
            folder = root / name
            truth = read_boxes(folder / "groundtruth.txt")
            cover = folder / "cover.label"
            if cover.is_file():
                visible = np.array([float(v) for v in cover.read_text().split()]) > 0
                if len(visible) != len(truth):
                    raise SequenceError(f"{cover}: {len(visible)} rows against {len(truth)} boxes")
                truth[~visible] = np.nan
            return Sequence(name, folder, truth, _got10k_fps(folder / "meta_info.ini"))

        return Entry(name, read)

    return [entry(name) for name in (root / "list.txt").read_text().split()]


def _got10k_fps(meta: Path) -> float:
    parser = configparser.ConfigParser(interpolation=None)
    try:
        parser.read(meta)
        return float(parser.get("METAINFO", "anno_fps").removesuffix("Hz"))
    except (configparser.Error, ValueError):
        return 10.0  # at which the whole data set is annotated


def folder(root: Path) -> list[Entry]:
    """Videos beside NAME.txt, and folders of pictures (or with img/) with boxes inside or in NAME.txt beside."""
    found = []
    for path in sorted(root.iterdir()):
        is_video = path.suffix.lower() in VIDEOS and path.with_suffix(".txt").is_file()
        if is_video or (path.is_dir() and _boxes_of(path) is not None and _pictures_of(path) is not None):
            found += single(path)
    return found


def single(path: Path, boxes: Path | None = None) -> list[Entry]:
    """One video or one folder of pictures, with its boxes beside or in it, or in a file that is named."""

    def read() -> Sequence:
        file = boxes or _boxes_of(path)
        if file is None:
            raise SequenceError(f"{path}: no boxes beside it ({path.stem}.txt); name the file with --boxes")
        frames = path if path.is_file() else _pictures_of(path)
        if frames is None:
            raise SequenceError(f"{path}: no pictures in this folder")
        rate = video_fps(frames) if frames.is_file() else DEFAULT_FPS
        return Sequence(_stem(path), frames, read_boxes(file), rate)

    return [Entry(_stem(path), read)]


def boxes_only(root: Path) -> list[Entry]:
    """Ground truth alone, NAME.txt: results can be scored against it, nothing can be tracked."""

    def entry(file: Path) -> Entry:
        return Entry(file.stem, lambda: Sequence(file.stem, root / file.stem, read_boxes(file)))

    return [entry(file) for file in sorted(root.glob("*.txt"))]


def _stem(path: Path) -> str:
    return path.stem if path.is_file() else path.name


def _boxes_of(path: Path) -> Path | None:
    inside = [path / name for name in BOX_FILES] if path.is_dir() else []
    return next((p for p in (*inside, path.parent / f"{_stem(path)}.txt") if p.is_file()), None)


def _pictures_of(path: Path) -> Path | None:
    return next((p for p in (path, path / "img") if p.is_dir() and picture_files(p)), None)


def _subset(folder: Path, subset: str) -> Path:
    """folder/SUBSET where the archive has one, else the folder itself."""
    return next((p for p in (folder / subset, folder) if p.is_dir()), folder)


def _recording(pictures: Path, name: str) -> Path:
    """The folder of a sequence's pictures: its own, or that of the recording it is a part of (bird1 for bird1_2)."""
    whole = pictures / re.sub(r"_\d+$", "", name)
    return whole if not (pictures / name).is_dir() and whole.is_dir() else pictures / name

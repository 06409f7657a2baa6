"""Data sets in their published layouts: which one a folder is, and its sequences."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from tracker.eval import layouts
from tracker.eval.layouts import Entry
from tracker.eval.sequences import Sequence, SequenceError, picture_files


class Layout(Enum):
    """The layouts that can be read, as `--dataset` names them."""

    INDEX = "index"  # index.json: name, video, boxes, fps, attributes
    UAV123 = "uav123"  # data_seq/UAV123, anno/UAV123, anno/UAV123/att
    UAV123_10FPS = "uav123_10fps"
    UAV20L = "uav20l"  # data_seq/UAV123, anno/UAV20L
    UAVTRACK112 = "uavtrack112"  # data_seq, anno, att
    UAVTRACK112_L = "uavtrack112_l"  # data_seq, anno_l (or anno), att_l (or att)
    DTB70 = "dtb70"  # NAME/img, NAME/groundtruth_rect.txt
    OTB = "otb"  # the same, with its odd ones
    GOT10K = "got10k"  # val/list.txt, val/NAME/groundtruth.txt
    FOLDER = "folder"  # videos, or folders of pictures, each with its boxes
    SINGLE = "single"  # one video, or one folder of pictures
    BOXES = "boxes"  # ground truth alone: enough to score results, not to track


@dataclass(frozen=True, slots=True)
class Broken:
    """A sequence that cannot be used, and why, in one line."""

    name: str
    reason: str


@dataclass(frozen=True, slots=True)
class Dataset:
    """What was found: layout, sequences in order, and those that cannot be read."""

    layout: Layout
    sequences: tuple[Sequence, ...]
    broken: tuple[Broken, ...] = ()


def read_dataset(path: Path, layout: Layout | None = None, boxes: Path | None = None) -> Dataset:
    """The data set at a path; the layout is recognised where none is named.

    boxes: ground truth of a single video or folder of pictures that is not beside it.
    Raises SequenceError where there is not one sequence; one that is broken does not hide the others.
    """
    if not path.exists():
        raise SequenceError(f"{path}: no such folder of sequences, and no such video")
    if boxes is not None and layout not in (None, Layout.SINGLE):
        raise SequenceError(f"{boxes}: boxes are named for a single video or folder of pictures only")
    layout = Layout.SINGLE if boxes is not None else layout or detect(path)
    entries = layouts.single(path, boxes) if layout is Layout.SINGLE else _READERS[layout](path)
    sequences, broken = [], []
    for entry in entries:
        try:
            sequences.append(_checked(entry.read()))
        except (SequenceError, OSError) as error:
            broken.append(Broken(entry.name, str(error)))
    if not sequences and not broken:
        raise SequenceError(f"{path}: no sequences in the layout '{layout.value}'")
    return Dataset(layout, tuple(sequences), tuple(broken))


def detect(path: Path) -> Layout:
    """The layout of a folder or file. Raises SequenceError where it is none of them."""
    if path.is_file():
        return Layout.SINGLE
    found = next((layout for layout, fits in _tests() if fits(path)), None)
    if found is None:
        raise SequenceError(f"{path}: no index.json, no known benchmark, and no video or pictures beside boxes")
    return found


def _tests() -> Iterator[tuple[Layout, Callable[[Path], bool]]]:
    """In the order in which they are tried: the more particular first."""
    yield Layout.INDEX, lambda p: (p / "index.json").is_file()
    yield Layout.UAV123_10FPS, lambda p: _is_uav(p) and layouts.is_10fps(p)
    yield Layout.UAVTRACK112_L, lambda p: _is_uav(p) and p.name.lower().endswith("112_l")
    yield Layout.UAVTRACK112, lambda p: _is_uav(p) and _is_uavtrack112(p)
    yield Layout.UAV123, _is_uav
    yield Layout.GOT10K, lambda p: layouts.got10k_root(p) is not None
    yield Layout.DTB70, lambda p: "dtb" in p.name.lower() and _any(p.glob("*/groundtruth_rect*.txt"))
    yield Layout.OTB, lambda p: _any(p.glob("*/groundtruth_rect*.txt"))
    yield Layout.SINGLE, lambda p: bool(picture_files(p))
    yield Layout.FOLDER, lambda p: bool(layouts.folder(p))
    yield Layout.BOXES, lambda p: _any(p.glob("*.txt"))


def _is_uav(path: Path) -> bool:
    return (path / "data_seq").is_dir() and ((path / "anno").is_dir() or (path / "anno_l").is_dir())


def _is_uavtrack112(path: Path) -> bool:
    return "uavtrack" in path.name.lower() or (path / "att").is_dir() or (path / "anno_l").is_dir()


def _any(found: Iterable[Path]) -> bool:
    return next(iter(found), None) is not None


def _checked(sequence: Sequence) -> Sequence:
    first = sequence.truth_xywh[0]
    if not (first[2:] > 0).all():  # NaN too
        raise SequenceError(f"{sequence.name}: no box in the first frame to begin with")
    return sequence


_READERS: dict[Layout, Callable[[Path], list[Entry]]] = {
    Layout.INDEX: layouts.index,
    Layout.UAV123: lambda p: layouts.uav(p, "UAV123", 30.0),
    Layout.UAV123_10FPS: lambda p: layouts.uav(p, "UAV123_10fps", 10.0),
    Layout.UAV20L: lambda p: layouts.uav(p, "UAV20L", 30.0),
    Layout.UAVTRACK112: lambda p: layouts.uavtrack112(p, long=False),
    Layout.UAVTRACK112_L: lambda p: layouts.uavtrack112(p, long=True),
    Layout.DTB70: layouts.groundtruth_rect,
    Layout.OTB: layouts.groundtruth_rect,
    Layout.GOT10K: layouts.got10k,
    Layout.FOLDER: layouts.folder,
    Layout.BOXES: layouts.boxes_only,
}

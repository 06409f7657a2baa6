"""ImageNet VID 2015: clips with the boxes of every object of 30 classes followed through them.

Layout (readme.txt of the ILSVRC2015 development kit, section 4.2; https://image-net.org/challenges/LSVRC/2015):
Data/VID/train/ILSVRC2015_VID_train_0000/ILSVRC2015_train_00000000/000000.JPEG and the same path with .xml under
Annotations/VID/train; val has no folders of a thousand clips between. Frames count from 0. An object's trackid is
its own within the clip; `name` is a WordNet id. Boxes are whole pixels counted from 0 with xmax and ymax within the
box (the kit's eval_vid_detection.m adds 1), so w = xmax - xmin + 1. Occluded and generated (interpolated) boxes are
taken, as the authors of the paper do. Licence: for research and education, not commercial.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

from tracker.train.datasets.files import in_order, need_folder, spread
from tracker.train.datasets.index import DatasetError, Index, IndexWriter

TRAIN, VAL = "train", "val"
REACH = 100  # frames between template and search, as the paper trains


@dataclass(frozen=True, slots=True)
class Seen:
    """One object on one frame: x, y, w, h px."""

    track: str
    name: str
    box: tuple[float, float, float, float]


Frame = tuple[str, tuple[float, float], list[Seen]]  # file name without its end, size px, objects


def home(root: Path) -> Path:
    """The folder with Annotations and Data: the root itself, or ILSVRC2015 in it."""
    need_folder(root, "root of ImageNet VID")
    return root / "ILSVRC2015" if (root / "ILSVRC2015").is_dir() else root


def clips_of(root: Path, subset: str) -> list[Path]:
    """The folders of annotations, one a clip."""
    top = need_folder(home(root) / "Annotations" / "VID" / subset, "ImageNet VID's annotations")
    need_folder(home(root) / "Data" / "VID" / subset, "ImageNet VID's pictures")
    inner = sorted(p for p in top.iterdir() if p.is_dir())
    clips = []
    for folder in inner:
        deeper = sorted(p for p in folder.iterdir() if p.is_dir())
        clips += deeper or [folder]
    if not clips:
        raise DatasetError(f"{top}: no clips in it (ImageNet VID's annotations)")
    return clips


def sources(root: Path, subset: str) -> list[Path]:
    """What the index is made from: the clips' folders stand for the million files in them."""
    return clips_of(root, subset)


def read(root: Path, subset: str, limit: int | None) -> Index:
    """Index `limit` clips; raises DatasetError naming the file and what is wrong in it."""
    clips = spread(clips_of(root, subset), limit)
    annotations, pictures = home(root) / "Annotations", home(root) / "Data"
    index = IndexWriter()
    for clip, frames in zip(clips, in_order(frames_of, clips, f"ImageNet VID {subset}"), strict=True):
        folder = pictures / clip.relative_to(annotations)
        images, tracks = [], defaultdict(list)
        for name, size, objects in frames:
            image = index.picture(folder, f"{name}.JPEG", int(name))
            images.append(image)
            for seen in objects:
                thing = index.thing(image, seen.box, seen.name, size)
                if thing is not None:
                    tracks[seen.track].append(thing)
        index.clip(images)
        for things in tracks.values():
            index.track(things)
    return index.finish()


def frames_of(clip: Path) -> list[Frame]:
    """The clip's frames in order."""
    return [frame_of(path) for path in sorted(clip.glob("*.xml"))]


def frame_of(path: Path) -> Frame:
    """One xml file; raises DatasetError."""
    try:
        top = ElementTree.parse(path).getroot()
        size = (float(_text(top, "size/width")), float(_text(top, "size/height")))
        int(path.stem)
        return path.stem, size, [_seen(item) for item in top.iter("object")]
    except (ElementTree.ParseError, ValueError) as error:
        raise DatasetError(f"{path}: {error}") from error


def _seen(item: ElementTree.Element) -> Seen:
    x1, y1, x2, y2 = (float(_text(item, f"bndbox/{k}")) for k in ("xmin", "ymin", "xmax", "ymax"))
    return Seen(_text(item, "trackid"), _text(item, "name"), (x1, y1, x2 - x1 + 1, y2 - y1 + 1))


def _text(item: ElementTree.Element, where: str) -> str:
    text = item.findtext(where)
    if not text:
        raise ValueError(f"no {where} in <{item.tag}>")
    return text

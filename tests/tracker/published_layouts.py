"""Tiny data sets in their published layouts, and how they are read."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from tracker.train.datasets import load_sources
from tracker.train.pack import Imagery

SIZE = (160, 120)  # w, h px


def picture(path: Path, seed: int = 0) -> None:
    """A picture with texture, as its name's ending says."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    image = cv2.resize(rng.integers(0, 255, (15, 20, 3), np.uint8), SIZE, interpolation=cv2.INTER_CUBIC)
    ending = path.suffix.lower().replace("jpeg", "jpg")
    assert cv2.imencode(ending, image)[1].tofile(path) is None


def coco(root: Path, subset: str = "train2017") -> Path:
    """Three pictures: two outlined objects, one by run lengths, a crowd, one too small, one that fills it all."""
    images = [{"id": 9 + k, "file_name": f"{9 + k:012d}.jpg", "width": 160, "height": 120} for k in range(3)]
    for k, image in enumerate(images):
        picture(root / subset / image["file_name"], k)
    square = [30.0, 20.0, 70.5, 20.0, 70.5, 60.25, 30.0, 60.25]
    column = [10 * 120 + 10] + [40, 80] * 19 + [40, 70 + 130 * 120]  # 20 columns from x = 10, 40 rows from y = 10
    runs = {"size": [120, 160], "counts": column}

    def entry(image: int, category: int, bbox: list[float], segmentation: object, iscrowd: int = 0) -> dict:
        return {"id": 1, "image_id": image, "category_id": category, "bbox": bbox, "iscrowd": iscrowd} | {
            "segmentation": segmentation,
            "area": 1.0,
        }

    annotations = [
        entry(9, 18, [30.0, 20.0, 40.5, 40.25], [square]),
        entry(9, 1, [80.25, 20.5, 30.0, 50.0], [[80.25, 20.5, 110.25, 20.5, 95, 70.5], square]),
        entry(10, 1, [10, 10, 20, 40], runs),
        entry(10, 1, [0, 0, 100, 100], {"size": [120, 160], "counts": [0, 160 * 120]}, iscrowd=1),
        entry(11, 18, [5, 5, 9, 40], [square]),
        entry(11, 18, [0, 0, 160, 119], [square]),
    ]
    categories = [{"id": 1, "name": "person"}, {"id": 18, "name": "dog"}]
    (root / "annotations").mkdir(parents=True, exist_ok=True)
    (root / "annotations" / f"instances_{subset}.json").write_text(
        json.dumps({"info": {}, "images": images, "annotations": annotations, "categories": categories})
    )
    return root


def vid_object(track: int, xmin: int, ymin: int, xmax: int, ymax: int, name: str = "n02084071") -> str:
    return (
        f"<object><trackid>{track}</trackid><name>{name}</name><bndbox><xmax>{xmax}</xmax><xmin>{xmin}</xmin>"
        f"<ymax>{ymax}</ymax><ymin>{ymin}</ymin></bndbox><occluded>0</occluded><generated>1</generated></object>"
    )


def vid(root: Path, subset: str = "train", clips: int = 2, between: bool = True) -> Path:
    """Clips of five frames: object 0 absent on the third, object 1 seen on one frame only."""
    for clip in range(clips):
        name = f"ILSVRC2015_{subset}_{clip:08d}"
        inner = Path("VID") / subset / (f"ILSVRC2015_VID_{subset}_0000" if between else "") / name
        (root / "Annotations" / inner).mkdir(parents=True)
        for frame in range(5):
            picture(root / "Data" / inner / f"{frame:06d}.JPEG", frame)
            objects = "" if frame == 2 else vid_object(0, 20 + frame, 30, 59 + frame, 69)
            objects += vid_object(1, 0, 0, 29, 19) if frame == 4 else ""
            (root / "Annotations" / inner / f"{frame:06d}.xml").write_text(
                f"<annotation><folder>{name}</folder><filename>{frame:06d}</filename><source/>"
                f"<size><width>160</width><height>120</height></size>{objects}</annotation>"
            )
    return root


def got10k(root: Path, subset: str = "train", clips: int = 2) -> Path:
    """Sequences of six frames: absent on the third, wholly covered on the fifth."""
    names = [f"GOT-10k_{subset.capitalize()}_{k + 1:06d}" for k in range(clips)]
    for name in names:
        folder = root / subset / name
        for frame in range(6):
            picture(folder / f"{frame + 1:08d}.jpg", frame)
        lines = [f"{20.5 + k:.4f},30.0000,40.2500,35.0000" for k in range(6)]
        (folder / "groundtruth.txt").write_text("\n".join(lines) + "\n")
        (folder / "absence.label").write_text("0\n0\n1\n0\n0\n0\n")
        (folder / "cover.label").write_text("8\n7\n0\n5\n0\n8\n")
        (folder / "meta_info.ini").write_text("[METAINFO]\nobject_class: racing car\nresolution: (160, 120)\n")
    (root / subset / "list.txt").write_text("\n".join(names) + "\n")
    return root


def vimeo(root: Path, frames: int = 3, subset: str = "train") -> Path:
    """Two sequences, and a blank last line as in the published list."""
    for k in (1, 2):
        for frame in range(1, frames + 1):
            picture(root / "sequences" / "00001" / f"{k:04d}" / f"im{frame}.png", frame)
    kind = {3: "tri", 7: "sep"}[frames]
    (root / f"{kind}_{subset}list.txt").write_text("00001/0001\n00001/0002\n\n")
    return root


WRITERS = {"coco": coco, "vid": vid, "got10k": got10k, "vimeo": vimeo}


def one(kind: str, root: Path, split: str = "train", **more: object) -> Imagery:
    return load_sources([{"dataset": kind, "root": str(root), **more}], root.parent, split)


def boxes(imagery: Imagery) -> list[tuple[float, ...]]:
    return [t.box for t in imagery.things]

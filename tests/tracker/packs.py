"""A tiny pack of drawn pictures in the training packs' layout."""

from __future__ import annotations

import json
import tarfile
from pathlib import Path

import cv2
import numpy as np


def write_pack(folder: Path, count: int = 6, split: str = "train") -> Path:
    """Stills with one box, one outline each, and a clip of three frames with a track."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(3)
    records = []
    for i in range(count):
        image = cv2.resize(rng.integers(0, 255, (24, 32, 3), np.uint8), (320, 240), interpolation=cv2.INTER_CUBIC)
        x, y = 60 + 12 * i, 50 + 8 * i
        cv2.rectangle(image, (x, y), (x + 50, y + 36), (0, 0, 255), -1)
        cv2.imwrite(str(folder / f"{i:05d}.webp"), image)
        record = {"f": f"{i:05d}.webp", "part": "drawn", "split": split, "w": 320, "h": 240, "boxes": [[x, y, 50, 36]]}
        record["classes"] = ["box"]
        if i % 2:
            record["segs"] = [[[x, y, x + 50, y, x + 50, y + 36, x, y + 36]]]
        if i >= count - 3:
            record |= {"clip": "drawn", "frame": i, "tids": [1]}
        records.append(record)
    (folder / "pack.json").write_text(json.dumps(records))
    return folder


def as_tar(folder: Path) -> Path:
    """The same pack as one tar file."""
    path = folder.with_suffix(".tar")
    with tarfile.open(path, "w") as tar:
        for file in sorted(folder.iterdir()):
            tar.add(file, file.name)
    return path

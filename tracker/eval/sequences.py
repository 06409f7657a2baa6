"""Recorded sequences with ground truth: a video, or a folder of pictures, and a text file of boxes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray


class SequenceError(ValueError):
    """A sequence cannot be read; the message names the file and the reason."""


@dataclass(frozen=True, slots=True)
class Sequence:
    """name, where its frames are (video file or folder of pictures), truth (N,4) x,y,w,h px, NaN = absent."""

    name: str
    frames: Path
    truth_xywh: NDArray[np.float64]
    fps: float = 10.0

    def images(self) -> Iterator[NDArray[np.uint8]]:
        """The frames in order, BGR uint8. Raises SequenceError where one cannot be read."""
        return _folder_images(self.frames) if self.frames.is_dir() else _video_images(self.frames)


def _video_images(path: Path) -> Iterator[NDArray[np.uint8]]:
    capture = cv2.VideoCapture(str(path))
    if not capture.isOpened():
        raise SequenceError(f"{path}: not a video that can be read")
    try:
        while True:
            ok, image = capture.read()
            if not ok:
                return
            yield np.asarray(image, np.uint8)
    finally:
        capture.release()


def _folder_images(path: Path) -> Iterator[NDArray[np.uint8]]:
    for file in sorted(p for p in path.iterdir() if p.suffix.lower() in {".jpg", ".jpeg", ".png", ".bmp"}):
        image = cv2.imread(str(file), cv2.IMREAD_COLOR)
        if image is None:
            raise SequenceError(f"{file}: not a picture that can be read")
        yield np.asarray(image, np.uint8)


def read_boxes(path: Path) -> NDArray[np.float64]:
    """Boxes x,y,w,h (N,4), one per line, separated by comma, space or tab; NaN allowed.

    Raises SequenceError naming the file and line.
    """
    rows = []
    for number, line in enumerate(path.read_text().splitlines(), 1):
        if not line.strip():
            continue
        try:
            row = [float(v) for v in line.replace(",", " ").split()]
        except ValueError:
            raise SequenceError(f"{path} line {number}: not numbers: {line.strip()[:40]!r}") from None
        if len(row) != 4:
            raise SequenceError(f"{path} line {number}: {len(row)} values where x,y,w,h are wanted")
        rows.append(row)
    if not rows:
        raise SequenceError(f"{path}: holds no boxes")
    return np.array(rows)


def load_dataset(folder: Path) -> list[Sequence]:
    """Sequences of a folder with index.json (name, video, boxes, fps), or of NAME.mp4 beside NAME.txt.

    Raises SequenceError where there are none.
    """
    index = folder / "index.json"
    if index.exists():
        entries = json.loads(index.read_text())
        return [
            Sequence(e["name"], folder / e["video"], read_boxes(folder / e["boxes"]), float(e.get("fps", 10)))
            for e in entries
        ]
    found = [
        Sequence(p.stem, p, read_boxes(p.with_suffix(".txt")))
        for p in sorted(folder.glob("*.*"))
        if p.suffix.lower() in {".mp4", ".avi", ".mkv", ".mov"} and p.with_suffix(".txt").exists()
    ]
    if not found:
        raise SequenceError(f"{folder}: no index.json and no video beside a .txt of boxes")
    return found

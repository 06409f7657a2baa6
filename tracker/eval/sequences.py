"""A recorded sequence with ground truth: a video, or a folder of pictures, and one box per frame."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

PICTURES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".webp"})
DEFAULT_FPS = 30.0
VIDEOS = frozenset({".mp4", ".avi", ".mkv", ".mov", ".m4v", ".webm"})


class SequenceError(ValueError):
    """A sequence cannot be read; the message names the file and the reason."""


@dataclass(frozen=True, slots=True)
class Sequence:
    """One recorded sequence.

    frames: video file, or folder of pictures. truth_xywh: (N,4) x,y,w,h px, NaN = absent.
    first_number: the number in the first picture's file name (parts of a longer recording), None: the first there is.
    is_part: pictures after the last box belong to other sequences; otherwise they are a fault.
    attributes: short names of its difficulties; None where nobody has written them down.
    omitted: rows of the published ground truth before the first one here (other toolkits' results may have them).
    """

    name: str
    frames: Path
    truth_xywh: NDArray[np.float64]
    fps: float = 10.0
    first_number: int | None = None
    is_part: bool = False
    attributes: tuple[str, ...] | None = None
    omitted: int = 0

    def __len__(self) -> int:
        return len(self.truth_xywh)

    def images(self) -> Iterator[NDArray[np.uint8]]:
        """The frames in order, BGR uint8, as many as boxes. Raises SequenceError where one is missing or too many."""
        source = self._pictures() if self.frames.is_dir() else _video_images(self.frames)
        count = 0
        for image in source:
            if count == len(self):
                if self.is_part:
                    return
                raise SequenceError(f"{self.frames}: more frames than the {len(self)} boxes")
            count += 1
            yield image
        if count < len(self):
            raise SequenceError(f"{self.frames}: {count} frames against {len(self)} boxes")

    def _pictures(self) -> Iterator[NDArray[np.uint8]]:
        for file in self._picture_files():
            image = cv2.imread(str(file), cv2.IMREAD_COLOR)
            if image is None:
                raise SequenceError(f"{file}: not a picture that can be read")
            yield np.asarray(image, np.uint8)

    def _picture_files(self) -> list[Path]:
        files = picture_files(self.frames)
        if self.first_number is None:
            return files
        by_number = {picture_number(file): file for file in files}
        wanted = range(self.first_number, self.first_number + len(self))
        missing = next((number for number in wanted if number not in by_number), None)
        if missing is not None:
            raise SequenceError(f"{self.frames}: picture number {missing} of {self.name} is missing")
        return [by_number[number] for number in wanted]


def picture_files(folder: Path) -> list[Path]:
    """The pictures of a folder in the order of their numbers, then names."""
    files = [p for p in folder.iterdir() if p.suffix.lower() in PICTURES]
    return sorted(files, key=lambda p: (picture_number(p), p.name))


def picture_number(file: Path) -> int:
    """The last number in a picture's name, -1 without one."""
    found = re.findall(r"\d+", file.stem)
    return int(found[-1]) if found else -1


def video_fps(path: Path) -> float:
    """Frames a second as a video's header says; 30 where it says nothing, or cannot be read."""
    capture = cv2.VideoCapture(str(path))
    rate = float(capture.get(cv2.CAP_PROP_FPS)) if capture.isOpened() else 0.0
    capture.release()
    return rate if 0 < rate < 1000 else DEFAULT_FPS


def _video_images(path: Path) -> Iterator[NDArray[np.uint8]]:
    if not path.exists():
        raise SequenceError(f"{path}: no such video or folder of pictures")
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


def read_boxes(path: Path) -> NDArray[np.float64]:
    """Boxes x,y,w,h (N,4), one per line, separated by comma, space, tab or semicolon; NaN allowed.

    Raises SequenceError naming the file and line.
    """
    rows = []
    for number, line in enumerate(_text(path).splitlines(), 1):
        if not line.strip():
            continue
        try:
            row = [float(v) for v in re.split(r"[,;\s]+", line.strip().strip(",;"))]
        except ValueError:
            raise SequenceError(f"{path} line {number}: not numbers: {line.strip()[:40]!r}") from None
        if len(row) != 4:
            raise SequenceError(f"{path} line {number}: {len(row)} values where x,y,w,h are wanted")
        rows.append(row)
    if not rows:
        raise SequenceError(f"{path}: holds no boxes")
    return np.array(rows)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise SequenceError(f"{path}: no such file of boxes") from None
    except UnicodeDecodeError:
        raise SequenceError(f"{path}: not a text file of boxes") from None


def load_dataset(path: Path) -> list[Sequence]:
    """Sequences of a data set in any layout that `tracker.eval.datasets` knows. Raises SequenceError for the first
    that is broken, or where there are none.
    """
    from tracker.eval.datasets import read_dataset  # its readers build on this module

    dataset = read_dataset(path)
    if dataset.broken:
        raise SequenceError(dataset.broken[0].reason)
    return list(dataset.sequences)

"""Tiny data sets in published layouts, and trackers that need no network; importable by worker processes."""

from __future__ import annotations

import time
from pathlib import Path

import cv2
import numpy as np

from tracker.box import Box, TrackResult
from tracker.crop import Image

SIDE_PX = 12


def truth(count: int, step_px: float = 2.0) -> np.ndarray:
    """(count,4) boxes of a square that moves right."""
    x = 5 + step_px * np.arange(count)
    return np.stack([x, np.full(count, 8.0), np.full(count, SIDE_PX), np.full(count, SIDE_PX)], axis=1)


def write_pictures(folder: Path, numbers: range, digits: int = 4, suffix: str = ".png") -> None:
    """Grey pictures whose brightness is their number, so that a test sees which was read."""
    folder.mkdir(parents=True, exist_ok=True)
    for number in numbers:
        picture = np.full((32, 64, 3), number % 256, np.uint8)
        assert cv2.imwrite(str(folder / f"{number:0{digits}d}{suffix}"), picture)


def write_boxes(path: Path, boxes: np.ndarray, separator: str = ",") -> None:
    """One box per line."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(separator.join(f"{v:g}" for v in row) + "\n" for row in boxes))


def sequence_folder(root: Path, name: str, count: int) -> Path:
    """A folder of pictures with its boxes inside."""
    write_pictures(root / name, range(1, count + 1))
    write_boxes(root / name / "groundtruth.txt", truth(count))
    return root / name


class StillTracker:
    """Says for ever where the box was at first. slow_s: seconds that each update takes."""

    slow_s = 0.0

    def init(self, frame_bgr: Image, box: Box) -> None:
        self._box = box

    def update(self, frame_bgr: Image) -> TrackResult:
        time.sleep(self.slow_s)
        return TrackResult(self._box, 1.0, 1.0)


class MovingTracker(StillTracker):
    """Knows that the square moves two pixels a frame, and reads the frame's number from its brightness."""

    def init(self, frame_bgr: Image, box: Box) -> None:
        self._first, self._begin = int(frame_bgr[0, 0, 0]), box

    def update(self, frame_bgr: Image) -> TrackResult:
        time.sleep(self.slow_s)
        gone, box = int(frame_bgr[0, 0, 0]) - self._first, self._begin
        return TrackResult(Box(box.cx_px + 2.0 * gone, box.cy_px, box.w_px, box.h_px), 1.0, 1.0)

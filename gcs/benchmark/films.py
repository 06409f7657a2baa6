"""Pictures to track in: a sequence that ships, at its own size or another, and one drawn here."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sitl_mocks import sequences
from tracker.box import Box

Image = NDArray[np.uint8]

BOX = Box.from_xywh(600, 340, 60, 50)  # of `frame`


@dataclass(frozen=True, slots=True)
class Film:
    """Pictures in order, all of one size, and the target's box in the first."""

    name: str
    frames: tuple[Image, ...]
    box: Box

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in px."""
        height, width = self.frames[0].shape[:2]
        return width, height


def sample(most: int | None = None) -> Film:
    """The sequence that `gcs dry-run --sample` takes, or its first pictures."""
    name = sequences.names()[0]
    x, y, w, h = map(float, sequences.path(name, ".txt").read_text().splitlines()[0].split(","))
    capture = cv2.VideoCapture(str(sequences.path(name)))
    frames: list[Image] = []
    while most is None or len(frames) < most:
        came, image = capture.read()
        if not came:
            break
        frames.append(np.asarray(image, np.uint8))
    capture.release()
    return Film(name, tuple(frames), Box.from_xywh(x, y, w, h))


def resized(film: Film, width_px: int, height_px: int) -> Film:
    """The same at another size; its shape may change."""
    x, y = width_px / film.size[0], height_px / film.size[1]
    box = Box(film.box.cx_px * x, film.box.cy_px * y, film.box.w_px * x, film.box.h_px * y)
    frames = (cv2.resize(frame, (width_px, height_px), interpolation=cv2.INTER_CUBIC) for frame in film.frames)
    return Film(film.name, tuple(np.asarray(frame, np.uint8) for frame in frames), box)


def frame(step: int, size: tuple[int, int] = (720, 1280)) -> Image:
    """A textured picture of (height, width) with a square that moves 2 px a step; at 720p it begins in `BOX`."""
    rng = np.random.default_rng(1)
    small = rng.integers(0, 255, (size[0] // 8, size[1] // 8, 3), np.uint8)
    image = cv2.resize(small, (size[1], size[0]), interpolation=cv2.INTER_CUBIC)
    x = 600 + 2 * step
    cv2.rectangle(image, (x, 340), (x + 60, 390), (20, 30, 220), -1)
    return np.asarray(image, np.uint8)

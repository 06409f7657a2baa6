"""Where a lost target may be, and so where to look next."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.motion import Homography

CELL_PX = 16  # of the map of where the target may be
START_SPREAD = 1.5  # mean sides of the box; how far off the target mostly is when it is first missed
DRIFT_PER_FRAME = 0.4  # mean sides, a random walk: as far as targets strayed from their expected way
ANYWHERE = 0.02  # part of the probability that is spread evenly again in each frame
MISS_RATE = 0.6  # chance that a look at the right place does not show the target: hidden, or turned


class SearchMap:
    """Where in the frame the target may be, as probabilities in cells of 16 px; looking moves them elsewhere.

    The theory of optimal search (Stone, 1975): look where most of the probability lies; what is seen to be
    empty loses all but the chance of having been overlooked; what is known blurs as time goes by.
    """

    def __init__(self, frame_wh_px: tuple[int, int], cx_px: float, cy_px: float, side_px: float) -> None:
        """Round (cx, cy), for a target of this mean side."""
        self._side_px = side_px
        columns, rows = (max(1, math.ceil(v / CELL_PX)) for v in frame_wh_px)
        x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
        distance = np.hypot(x * CELL_PX - cx_px, y * CELL_PX - cy_px) / (START_SPREAD * side_px)
        self._mass = _normalised(np.exp(-0.5 * np.minimum(distance, 6) ** 2).astype(np.float32) + 1e-6)

    @property
    def mass(self) -> NDArray[np.float32]:
        """Probability per cell (rows, columns); sums to 1."""
        return self._mass

    def move(self, motion: Homography | None, velocity_px: tuple[float, float] = (0.0, 0.0)) -> None:
        """To the next frame: along with the background and on by the target's own velocity (px per frame)."""
        step = np.array([[1, 0, velocity_px[0]], [0, 1, velocity_px[1]], [0, 0, 1]])
        whole = step @ motion if motion is not None else step
        # Cell (i, j) has its centre at ((i + 0.5), (j + 0.5)) cells, cv2 counts from the centre of the first.
        to_px = np.array([[CELL_PX, 0, CELL_PX / 2], [0, CELL_PX, CELL_PX / 2], [0, 0, 1]])
        matrix = np.linalg.inv(to_px) @ whole @ to_px
        rows, columns = self._mass.shape
        moved = cv2.warpPerspective(self._mass, matrix, (columns, rows), borderMode=cv2.BORDER_CONSTANT)
        sigma = max(0.3, DRIFT_PER_FRAME * self._side_px / CELL_PX)
        blurred = cv2.GaussianBlur(moved, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
        even = 1 / self._mass.size
        self._mass = (1 - ANYWHERE) * _normalised(np.asarray(blurred, np.float32)) + np.float32(ANYWHERE * even)

    def best(self, side_px: float) -> tuple[float, float]:
        """Centre (px) of the square of this side that holds most of the probability."""
        cells = max(1, round(side_px / CELL_PX)) | 1
        held = cv2.boxFilter(self._mass, -1, (cells, cells), normalize=False, borderType=cv2.BORDER_CONSTANT)
        row, column = np.unravel_index(int(np.argmax(held)), held.shape)
        return (float(column) + 0.5) * CELL_PX, (float(row) + 0.5) * CELL_PX

    def looked(self, cx_px: float, cy_px: float, side_px: float) -> None:
        """The square of this side was searched in vain."""
        rows, columns = self._mass.shape
        x = (np.arange(columns) + 0.5) * CELL_PX
        y = (np.arange(rows) + 0.5) * CELL_PX
        inside = np.outer(np.abs(y - cy_px) <= side_px / 2, np.abs(x - cx_px) <= side_px / 2)
        self._mass = _normalised(np.where(inside, self._mass * MISS_RATE, self._mass).astype(np.float32))


def _normalised(mass: NDArray[np.float32]) -> NDArray[np.float32]:
    total = float(mass.sum())
    if not total > 0:  # everything has left the frame
        return np.full_like(mass, 1 / mass.size)
    return np.asarray(mass / total, np.float32)

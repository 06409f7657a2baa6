"""Training targets on the 11x11 grid for one box in the 287 px search patch (the authors' AnchorTarget)."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

GRID = 11
STRIDE_PX = 16
FIRST_PX = 63  # patch coordinate of cell 0
HALF_PX = 143.0  # distances are coded as tanh(d / HALF_PX)

Array = NDArray[np.float32]


class Shuffler(Protocol):
    """Both np.random.Generator and the np.random module (for parity with the authors) are such."""

    def shuffle(self, x: NDArray[np.int64], /) -> None: ...


class Labels(NamedTuple):
    """Targets of one box.

    cls1 (1, 11, 11): 1 target, 0 background, -1 unused, -2 ring round the target, ignored.
    loc (4, 11, 11): tanh-coded distances of each cell to left, right, top, bottom, in 143 px.
    cls2 (1, 11, 11): soft closeness to the centre, 0..1. loc_weight (1, 11, 11): weight of the box loss.
    """

    cls1: Array
    loc: Array
    cls2: Array
    loc_weight: Array


def make_labels(box_xyxy_px: tuple[float, ...] | Array, rng: Shuffler, *, parity: bool = False) -> Labels:
    """Labels for a box (x1, y1, x2, y2) in px of the 287 px patch.

    parity=True repeats the authors' ring that wraps round to the far edge when it starts left of or above
    the grid; otherwise it is clamped there. A box inside a single cell marks that cell (theirs fails).
    """
    box = np.asarray(box_xyxy_px, np.float32)
    # int() after the clip: cells are counted from their lower neighbour, as the authors do.
    ix1, iy1, ix2, iy2 = (int(v) for v in np.clip((box - FIRST_PX) / STRIDE_PX, 0, GRID - 1))
    w, h = ix2 - ix1 + 1, iy2 - iy1 + 1
    field = _squared_distance((ix1 + ix2) / 2, (iy1 + iy2) / 2)
    spread = (w // 2 + h // 2) * 4
    weight = _bump(field, spread / 1.5)
    best = np.flatnonzero(weight > 0.8)
    weight.flat[_some(best, len(best) // 4, rng)] = 1.5
    cls1 = _cls1(ix1, iy1, ix2, iy2, rng, parity)  # draws after the weights, as the authors' does
    return Labels(cls1[None], _distances(box), _bump(field, spread / 1.2)[None], weight[None])


def _cls1(ix1: int, iy1: int, ix2: int, iy2: int, rng: Shuffler, parity: bool) -> Array:
    quarter_w, quarter_h = (ix2 - ix1 + 1) // 4, (iy2 - iy1 + 1) // 4
    labels = np.full((GRID, GRID), -1, np.float32)
    left, top = ix1 - quarter_w, iy1 - quarter_h
    if not parity:
        left, top = max(left, 0), max(top, 0)
    labels[top : iy2 + quarter_h + 1, left : ix2 + quarter_w + 1] = -2
    labels[iy1 + quarter_h : iy2 - quarter_h + 1, ix1 + quarter_w : ix2 - quarter_w + 1] = 1
    negatives = np.flatnonzero(labels == -1)
    labels.flat[_some(negatives, int((labels == 1).sum() * 2.5), rng)] = 0
    return labels


def _some(cells: NDArray[np.int64], count: int, rng: Shuffler) -> NDArray[np.int64]:
    """At most count of the cells, drawn without replacement."""
    if len(cells) <= count:
        return cells
    order = np.arange(len(cells))
    rng.shuffle(order)
    return cells[order[:count]]


def _distances(box: Array) -> Array:
    cells = FIRST_PX + STRIDE_PX * np.arange(GRID, dtype=np.float32)
    x, y = np.meshgrid(cells, cells)
    x1, y1, x2, y2 = box
    return np.tanh(np.stack([x - x1, x2 - x, y - y1, y2 - y]) / HALF_PX).astype(np.float32)


def _squared_distance(cx: float, cy: float) -> NDArray[np.float64]:
    rows, cols = np.mgrid[:GRID, :GRID]
    return np.asarray(16 * ((rows - cy) ** 2 + (cols - cx) ** 2), np.float64)


def _bump(field: NDArray[np.float64], radius: float) -> Array:
    """1 at the middle falling to 0 at the last cell inside the radius; the middle alone if none is inside."""
    inside = field < radius * radius
    if not inside.any():
        inside = field == field.min()
    low, high = field[inside].min(), field[inside].max()
    values = 1 - (field - low) / (high - low + 1e-4)
    return np.where(inside, values, 0).astype(np.float32)

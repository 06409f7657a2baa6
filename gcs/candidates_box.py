"""The box round what stands at a point: GrabCut in windows of growing size, and what most of them agree on.

Rother, Kolmogorov and Blake, "GrabCut" (2004), as in OpenCV. A window too small cuts parts of the thing, one too large
its surroundings; where neighbouring windows find the same outline, and that stands out, there is a thing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs.errors import SelectionError
from gcs.selection import MIN_SIDE_PX
from gcs.video.frame import Image
from tracker.box import Box

_SIDES_PX: Final = (20, 28, 40, 56, 80, 112, 160, 224)  # of the windows, in a picture of 1280 px or less
_SIDES_OF_RADIUS: Final = (2.5, 3.5, 5.0)
_WIDTH_PX: Final = 1280
_CUT_PX: Final = 48  # every window is brought to this size: 4 ms each
_RIM_PX: Final = 4  # of it, surely background
_SURE_FRAC: Final = 0.11  # radius of what is surely the thing, and of what may be, of the window's side
_MAY_BE_FRAC: Final = 0.3
_LEAST_FRAC, _MOST_FRAC = 0.01, 0.7  # of the window's area
_BAND_PX: Final = 3  # inside and outside the outline, to see how they differ
_TEXTURE: Final = 8.0  # grey levels: differences below mean little
_LEAST_CONTRAST: Final = 0.2
_COMMON_PX: Final = 30.0
_AGREE_IOU: Final = 0.4
_LEAST_SIDE_PX: Final = MIN_SIDE_PX + 1.0
_SQUARE_FRAC: Final = 0.04  # half the side of the square where nothing can be told, of the picture's longer side


@dataclass(frozen=True, slots=True)
class _Cut:
    """One window's outline; contrast: to what is round it, in standard deviations of that."""

    box: Box
    contrast: float


def box_at(image_bgr: Image, x_px: float, y_px: float, radius_px: float | None = None) -> Box:
    """The box round what stands at this point, inside the picture; a square where nothing stands out. About 40 ms.

    radius_px: about how large the thing is; None tries everything from 10 to 150 px. Raises SelectionError for a point
    outside the picture.
    """
    height_px, width_px = image_bgr.shape[:2]
    if not (0 <= x_px < width_px and 0 <= y_px < height_px):
        raise SelectionError(f"point {x_px:g},{y_px:g}: outside the picture of {width_px}x{height_px} px")
    longer_px = max(width_px, height_px)
    if radius_px is None:
        sides = [side * max(1.0, longer_px / _WIDTH_PX) for side in _SIDES_PX]
    else:
        sides = [radius_px * side for side in _SIDES_OF_RADIUS]
    cuts = [cut for side in sides if (cut := _cut(image_bgr, x_px, y_px, side)) is not None]
    if cuts:
        return inside(_agreed(cuts, radius_px), image_bgr)
    side_px = 2 * (radius_px or _SQUARE_FRAC * longer_px)
    return inside(Box(x_px, y_px, side_px, side_px), image_bgr)


def iou(a: Box, b: Box) -> float:
    """Intersection over union, 0..1."""
    width = min(a.cx_px + a.w_px / 2, b.cx_px + b.w_px / 2) - max(a.cx_px - a.w_px / 2, b.cx_px - b.w_px / 2)
    height = min(a.cy_px + a.h_px / 2, b.cy_px + b.h_px / 2) - max(a.cy_px - a.h_px / 2, b.cy_px - b.h_px / 2)
    both = max(width, 0.0) * max(height, 0.0)
    return both / max(a.w_px * a.h_px + b.w_px * b.h_px - both, 1e-9)


def _cut(image_bgr: Image, x_px: float, y_px: float, side_px: float) -> _Cut | None:
    """What GrabCut takes for the thing in this window; None where it fills the window, or next to nothing."""
    side = max(8, round(side_px))
    left, top = round(x_px - side_px / 2), round(y_px - side_px / 2)
    window = _window(image_bgr, left, top, side)
    mask = _first_guess()
    cv2.setRNGSeed(3)  # of this thread: the same click gives the same box
    cv2.grabCut(window, mask, (0, 0, 0, 0), np.zeros((1, 65)), np.zeros((1, 65)), 1, cv2.GC_INIT_WITH_MASK)
    thing = ((mask == cv2.GC_FGD) | (mask == cv2.GC_PR_FGD)).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(thing, connectivity=4)
    label = labels[_CUT_PX // 2, _CUT_PX // 2]
    x, y, w, h, area = (int(value) for value in stats[label])
    least, most = _RIM_PX + 1, _CUT_PX - _RIM_PX
    if x < least or y < least or x + w >= most or y + h >= most or not _LEAST_FRAC < area / _CUT_PX**2 < _MOST_FRAC:
        return None
    contrast = _contrast(window, (labels == label).astype(np.uint8))
    scale = side / _CUT_PX
    box = Box.from_xywh(left + x * scale, top + y * scale, w * scale, h * scale)
    return None if contrast < _LEAST_CONTRAST else _Cut(box, contrast)


def _window(image_bgr: Image, left: int, top: int, side: int) -> Image:
    """(_CUT_PX, _CUT_PX, 3) of the picture; beyond its edges what is at the edge."""
    height, width = image_bgr.shape[:2]
    inside = image_bgr[max(0, top) : min(height, top + side), max(0, left) : min(width, left + side)]
    beyond = max(0, -top), max(0, top + side - height), max(0, -left), max(0, left + side - width)
    window = cv2.copyMakeBorder(inside, *beyond, cv2.BORDER_REPLICATE)
    how = cv2.INTER_AREA if side > _CUT_PX else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(window, (_CUT_PX, _CUT_PX), interpolation=how), np.uint8)


def _first_guess() -> NDArray[np.uint8]:
    rows, columns = np.mgrid[:_CUT_PX, :_CUT_PX] - (_CUT_PX - 1) / 2
    away = np.hypot(rows, columns)
    mask = np.full((_CUT_PX, _CUT_PX), cv2.GC_PR_BGD, np.uint8)
    mask[away < _MAY_BE_FRAC * _CUT_PX] = cv2.GC_PR_FGD
    mask[away < _SURE_FRAC * _CUT_PX] = cv2.GC_FGD
    rim = np.ones_like(mask, dtype=bool)
    rim[_RIM_PX:-_RIM_PX, _RIM_PX:-_RIM_PX] = False
    mask[rim] = cv2.GC_BGD
    return mask


def _contrast(window: Image, thing: NDArray[np.uint8]) -> float:
    """How the colours just inside the outline differ from those just outside."""
    lab = cv2.cvtColor(window, cv2.COLOR_BGR2LAB).astype(np.float32)
    square = np.ones((3, 3), np.uint8)
    grown = cv2.dilate(thing, square, iterations=_BAND_PX) - cv2.dilate(thing, square)
    outside, inside = lab[grown > 0], lab[(thing - cv2.erode(thing, square, iterations=_BAND_PX)) > 0]
    if len(outside) < 8 or len(inside) < 4:
        return 0.0
    spread = _TEXTURE + math.sqrt(float(outside.var(0).sum()))
    return float(np.linalg.norm(inside.mean(0) - outside.mean(0))) / spread


def _agreed(cuts: list[_Cut], radius_px: float | None) -> Box:
    """The middle of those that agree with the best; weights fitted to pictures taken from the air."""
    best = max(cuts, key=lambda cut: _merit(cut, cuts, radius_px)).box
    edges = np.array([_edges(cut.box) for cut in cuts if cut.box == best or iou(cut.box, best) > _AGREE_IOU])
    left, top, right, bottom = (float(edge) for edge in np.median(edges, axis=0))
    return Box.from_xywh(left, top, right - left, bottom - top)


def _merit(cut: _Cut, cuts: list[_Cut], radius_px: float | None) -> float:
    others = sorted((iou(cut.box, other.box) for other in cuts if other is not cut), reverse=True)
    side_px = math.sqrt(cut.box.w_px * cut.box.h_px)
    if radius_px is None:
        size = math.log(side_px / _COMMON_PX)
        likely = 0.2 * size - 0.1 * size**2
    else:
        likely = -(math.log(side_px / (2 * radius_px)) ** 2)
    return 0.3 * math.log(cut.contrast + 0.05) + 0.6 * sum(others[:2]) / 2 + likely


def _edges(box: Box) -> tuple[float, float, float, float]:
    x, y, w, h = box.xywh
    return x, y, x + w, y + h


def inside(box: Box, image_bgr: Image) -> Box:
    """The part of it that is in the picture, grown to what a selection must have at least."""
    height_px, width_px = image_bgr.shape[:2]
    x, y, w, h = box.xywh
    left, right = _side(x, w, width_px)
    top, bottom = _side(y, h, height_px)
    return Box.from_xywh(left, top, right - left, bottom - top)


def _side(start: float, length: float, most: int) -> tuple[float, float]:
    low, high = max(start, 0.0), min(start + length, float(most))
    lacking = _LEAST_SIDE_PX - (high - low)
    if lacking > 0:
        low = min(max(low - lacking / 2, 0.0), max(most - _LEAST_SIDE_PX, 0.0))
        high = min(low + _LEAST_SIDE_PX, float(most))
    return low, high

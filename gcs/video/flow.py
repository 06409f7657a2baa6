"""How the background moved between two pictures: corners followed in a small grey copy, the target left out.

About a millisecond a frame on one core. OpenCV's corners and its pyramid of Lucas and Kanade.
"""

from __future__ import annotations

import math
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from control.image_rotation import FEWEST_POINTS, Flow
from gcs.video.frame import Image
from tracker.box import Box

_WIDTH_PX: Final = 160  # of the small copy, at most
_MANY: Final = 4  # a copy more than so much smaller is first thinned out: averaging all of it costs too much
_CORNERS: Final = 40
_QUALITY: Final = 0.02
_SPACING_FRAC: Final = 1 / 16  # of the small copy's width
_WINDOW_PX: Final = 11
_LEVELS: Final = 3
_GROWTH: Final = 1.3  # the box is never exact, and the target's shadow moves with it
_LONGEST_S: Final = 0.35  # a longer interval tells too little


class BackgroundFlow:
    """Give it one picture after the other, of one size; not to be shared between threads."""

    def __init__(self) -> None:
        self._grey: NDArray[np.uint8] | None = None
        self._t_s = 0.0
        self._target: Box | None = None

    def update(self, image_bgr: Image, t_arrival_s: float, target: Box | None) -> Flow | None:
        """The flow since the picture before; None where there is none, or nothing to hold on to.

        target: its box in this picture, px; what moves by itself is no background.
        """
        grey = _small_grey(image_bgr)
        before, from_t_s, hidden = self._grey, self._t_s, self._target
        self._grey, self._t_s, self._target = grey, t_arrival_s, target
        if before is None or before.shape != grey.shape or not 0.0 < t_arrival_s - from_t_s <= _LONGEST_S:
            return None
        scale = image_bgr.shape[1] / grey.shape[1]
        corners = cv2.goodFeaturesToTrack(
            before, _CORNERS, _QUALITY, grey.shape[1] * _SPACING_FRAC, mask=_mask(grey.shape, hidden, scale)
        )
        if corners is None or len(corners) < FEWEST_POINTS:
            return None
        start = np.asarray(corners, np.float32)
        moved, found, _ = cv2.calcOpticalFlowPyrLK(
            before, grey, start, start.copy(), winSize=(_WINDOW_PX, _WINDOW_PX), maxLevel=_LEVELS
        )
        kept = np.asarray(found).ravel() == 1
        if kept.sum() < FEWEST_POINTS:
            return None
        from_px, to_px = (
            (np.asarray(points, np.float64).reshape(-1, 2)[kept] + 0.5) * scale - 0.5 for points in (start, moved)
        )
        return Flow(from_t_s, t_arrival_s, from_px, to_px)


def _small_grey(image_bgr: Image) -> NDArray[np.uint8]:
    height, width = image_bgr.shape[:2]
    if width > _MANY * _WIDTH_PX:
        step = width // (_MANY * _WIDTH_PX) + 1
        image_bgr = image_bgr[::step, ::step]
    grey = cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY)
    if width > _WIDTH_PX:
        size = (_WIDTH_PX, max(1, round(height * _WIDTH_PX / width)))
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return np.asarray(grey, np.uint8)


def _mask(shape: tuple[int, ...], target: Box | None, scale: float) -> NDArray[np.uint8] | None:
    """255 where corners may be looked for."""
    if target is None or not target.is_valid:
        return None
    half_w, half_h = target.w_px * _GROWTH / 2, target.h_px * _GROWTH / 2
    x, y = target.cx_px, target.cy_px
    left, right, top, bottom = (edge / scale for edge in (x - half_w, x + half_w, y - half_h, y + half_h))
    mask = np.full(shape, 255, np.uint8)
    mask[max(0, int(top)) : max(0, math.ceil(bottom)), max(0, int(left)) : max(0, math.ceil(right))] = 0
    return mask

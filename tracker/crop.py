"""Cutting the square patches that the network sees out of a frame."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.box import Box

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]


def context_side_px(w_px: float, h_px: float, context_frac: float) -> float:
    """Side of the square in the frame that holds a w x h object and its context (SiamFC's s_z)."""
    context = context_frac * (w_px + h_px)
    return math.sqrt((w_px + context) * (h_px + context))


def mean_colour(frame_bgr: Image) -> Colour:
    """Mean BGR of the frame, truncated to whole grey levels as the authors' padding is."""
    b, g, r = cv2.mean(frame_bgr)[:3]
    return int(b), int(g), int(r)


def crop(frame_bgr: Image, cx_px: float, cy_px: float, side_px: int, out_px: int, fill: Colour) -> Image:
    """The square of side_px round (cx, cy), scaled to (out_px, out_px, 3) uint8.

    Where the square leaves the frame it is filled with `fill`. Only the square is built, never a padded copy
    of the frame; the pixels are those of the authors' code. Raises ValueError for a side under 1 px.
    """
    if side_px < 1:
        raise ValueError(f"crop side {side_px} px: must be at least 1")
    frame_h, frame_w = frame_bgr.shape[:2]
    half = (side_px + 1) / 2
    x0, y0 = math.floor(cx_px - half + 0.5), math.floor(cy_px - half + 0.5)
    left, right = _overhang(x0, side_px, frame_w)
    top, bottom = _overhang(y0, side_px, frame_h)
    if left + right >= side_px or top + bottom >= side_px:
        return np.full((out_px, out_px, 3), fill, np.uint8)
    window = frame_bgr[y0 + top : y0 + side_px - bottom, x0 + left : x0 + side_px - right]
    if left or right or top or bottom:
        bordered = cv2.copyMakeBorder(window, top, bottom, left, right, cv2.BORDER_CONSTANT, value=fill)
        window = np.asarray(bordered, np.uint8)
    if side_px != out_px:
        window = np.asarray(cv2.resize(window, (out_px, out_px)), np.uint8)
    return np.ascontiguousarray(window)


def _overhang(start: int, length: int, limit: int) -> tuple[int, int]:
    """How much of [start, start + length) lies before 0 and from `limit` on, at most `length` each."""
    return min(max(0, -start), length), min(max(0, start + length - limit), length)


def check_frame(frame_bgr: object) -> None:
    """Raise ValueError, with the figures, unless it is a non-empty (H, W, 3) uint8 image."""
    if not isinstance(frame_bgr, np.ndarray):
        raise ValueError(f"frame is {type(frame_bgr).__name__}: must be a numpy array (H, W, 3) of uint8")
    if frame_bgr.dtype != np.uint8 or frame_bgr.ndim != 3 or frame_bgr.shape[2] != 3 or frame_bgr.size == 0:
        raise ValueError(f"frame has shape {frame_bgr.shape}, {frame_bgr.dtype}: must be (H, W, 3) of uint8")


def check_box(box: Box, frame_bgr: Image, min_side_px: float) -> None:
    """Raise ValueError, with the figures, unless the box is a usable object inside the frame."""
    frame_h, frame_w = frame_bgr.shape[:2]
    x, y, w, h = box.xywh
    name = f"box x={x:.1f} y={y:.1f} w={w:.1f} h={h:.1f} px"
    if not all(map(math.isfinite, (x, y, w, h))):
        raise ValueError(f"{name}: all four must be finite numbers")
    if min(w, h) < min_side_px:
        raise ValueError(f"{name}: too small, each side must be at least {min_side_px:g} px")
    if w > frame_w or h > frame_h:
        raise ValueError(f"{name}: larger than the {frame_w}x{frame_h} frame")
    inside_w, inside_h = min(x + w, frame_w) - max(x, 0), min(y + h, frame_h) - max(y, 0)
    if min(inside_w, inside_h) < min_side_px:
        raise ValueError(f"{name}: outside the {frame_w}x{frame_h} frame")

"""The crop of `tracker.crop` from a frame that lies on a device: the same pixels, bit for bit.

OpenCV's bilinear resize of 8-bit images is fixed-point arithmetic: weights of 11 bits, rows first, then columns
with their low bits dropped. Only whole numbers are left to the device, so every device gives the same.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tracker.crop import Colour

Plan = NDArray[np.int32]

ONE = 2048  # a weight of 1
OUTSIDE = -1  # in place of an index: beyond the frame, where the fill colour is
TAPS = 4  # of one axis: index of the near and of the far pixel, and their weights


def plan_crop(
    frame_wh_px: tuple[int, int], cx_px: float, cy_px: float, side_px: int, out_px: int, fill: Colour
) -> Plan:
    """What `cut` needs to know, in one vector (8 * out_px + 3,): taps along x, then along y, then the fill colour.

    Arguments as those of `tracker.crop.crop`. Raises ValueError for a side under 1 px.
    """
    if side_px < 1:
        raise ValueError(f"crop side {side_px} px: must be at least 1")
    half = (side_px + 1) / 2
    starts = [math.floor(centre - half + 0.5) for centre in (cx_px, cy_px)]
    if any(start + side_px <= 0 or start >= size for start, size in zip(starts, frame_wh_px, strict=True)):
        nothing = np.repeat(np.array([OUTSIDE, OUTSIDE, ONE, 0], np.int32), out_px)
        return np.concatenate([nothing, nothing, np.array(fill, np.int32)])
    near, part = _places(side_px, out_px)
    # Along x OpenCV moves what lies before the window's first pixel, or after its last, onto it; along y it repeats
    # the row and leaves the weights: these two round differently.
    is_inside = (near >= 0) & (near < side_px - 1)
    x_taps = _taps(starts[0], side_px, frame_wh_px[0], near, np.where(is_inside, part, np.float32(0)))
    y_taps = _taps(starts[1], side_px, frame_wh_px[1], near, part)
    return np.concatenate([x_taps, y_taps, np.array(fill, np.int32)])


def _places(side_px: int, out_px: int) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Of each pixel that comes out: the pixel of the window before its middle, and how far it is beyond that."""
    scale = 1.0 / (out_px / side_px)  # as OpenCV computes it
    places = ((np.arange(out_px) + 0.5) * scale - 0.5).astype(np.float32)
    near = np.floor(places)
    return near.astype(np.int64), places - near


def _taps(start: int, side_px: int, limit: int, near: NDArray[np.int64], part: NDArray[np.float32]) -> Plan:
    """Taps (4 * out_px,) of one axis of the frame, `limit` px long, for a window from `start` on."""
    pairs = start + np.clip(np.stack([near, near + 1]), 0, side_px - 1)
    weights = np.rint(np.stack([np.float32(1) - part, part]) * np.float32(ONE))
    indices = np.where((pairs >= 0) & (pairs < limit), pairs, OUTSIDE)
    return np.concatenate([indices, weights.astype(np.int64)]).astype(np.int32).ravel()


def used_window(plan: Plan) -> tuple[slice, slice]:
    """Rows and columns of the frame that hold every pixel the plan asks for; both empty if it asks for none."""
    x_taps, y_taps = plan[:-3].reshape(2, TAPS, -1)
    rows, columns = (taps[:2][taps[:2] != OUTSIDE] for taps in (y_taps, x_taps))
    if not (rows.size and columns.size):
        return slice(0), slice(0)
    return slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1)


def cut(frame: Tensor, plan: Tensor) -> Tensor:
    """The patch (1, out_px, out_px, 3) uint8 of a frame (H, W, 3) uint8; plan as of `plan_crop`, on its device."""
    x_taps, y_taps = plan[:-3].view(2, TAPS, -1)  # (4, S) each
    out_px = x_taps.shape[1]
    columns, rows = x_taps[:2].flatten(), y_taps[:2].flatten()  # (2S,): all near ones, then all far ones
    pixels = frame[rows.clamp(min=0)[:, None], columns.clamp(min=0)]  # (2S, 2S, 3)
    is_outside = (rows == OUTSIDE)[:, None] | (columns == OUTSIDE)  # (2S, 2S)
    filled = torch.where(is_outside[..., None], plan[-3:], pixels.int())  # (2S, 2S, 3)
    x_near, x_far = x_taps[2:, :, None]  # (S, 1) each
    y_near, y_far = y_taps[2:, :, None, None]  # (S, 1, 1) each
    lines = (filled[:, :out_px] * x_near + filled[:, out_px:] * x_far) >> 4  # (2S, S, 3)
    quarters = ((lines[:out_px] * y_near) >> 16) + ((lines[out_px:] * y_far) >> 16)  # (S, S, 3), of a grey level
    patch: Tensor = (quarters + 2) >> 2
    return patch.to(torch.uint8)[None]

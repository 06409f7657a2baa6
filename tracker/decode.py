"""From the network's three maps to the new box: box decoding, scale-change penalty, window, smoothing."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tracker.box import Box
from tracker.configs import TrackerConfig
from tracker.correlation_filter import Response, peak_near, sample_response

Array = NDArray[np.float64]
CLEAR_RESPONSE = 0.4  # of a correlation filter that knows what it sees
RESPONSE_RANGE = (-0.2, 1.2)  # of a correlation filter; what is beyond says no more


@dataclass(frozen=True, slots=True)
class Calibration:
    """The network's bias on one object: factors on width and height; how far off (x, y) the centre, patch px."""

    size_gain: tuple[float, float]
    offset_px: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Decoded:
    """What one frame's maps say.

    box: the new state in frame px. score: of the best cell, without penalty and window (0 if none is usable).
    best: index of that cell, row by row, or None if no cell gives a usable box (box is then the old one).
    offsets_px (4, 121): each cell's box as centre offset from the patch centre, width, height, in patch px.
    scores, penalties, ranks (121,): score, scale-change penalty, and what the best cell is chosen by.
    centre_px: the new box's centre from the patch's, patch px. heard: the correlation filter's response there.
    """

    box: Box
    score: float
    best: int | None
    offsets_px: Array
    scores: Array
    penalties: Array
    ranks: Array
    centre_px: tuple[float, float] = (0.0, 0.0)
    heard: float = 0.0


@np.errstate(all="ignore")  # unusable cells divide by zero and so on; they are sorted out at the end
def decode(
    loc: ArrayLike,
    cls1: ArrayLike,
    cls2: ArrayLike,
    old: Box,
    scale: float,
    frame_wh_px: tuple[int, int],
    config: TrackerConfig,
    calibration: Calibration | None = None,
    response: Response | None = None,
) -> Decoded:
    """The best cell's box, brought from the search patch to the frame and smoothed.

    loc (4, 11, 11), cls1 (2, 11, 11), cls2 (1, 11, 11) raw network outputs; scale: patch px per frame px.
    calibration: the network's bias on this object, taken out of every cell. response: of the correlation filter.
    Not-finite or turned-over (no width or height) cells are never chosen.
    """
    offsets = decode_offsets(np.asarray(loc, np.float64), config)
    if calibration is not None:
        offsets[:2] -= np.array(calibration.offset_px)[:, None]
        offsets[2:] *= np.array(calibration.size_gain)[:, None]
    scores = _scores(np.asarray(cls1, np.float64), np.asarray(cls2, np.float64), config)
    penalties = _penalties(offsets[2], offsets[3], old.w_px * scale, old.h_px * scale, config.penalty_k)
    ranks = penalties * scores
    if response is not None:
        heard_cells = np.clip(sample_response(response, offsets[0], offsets[1]), *RESPONSE_RANGE)
        ranks = (1 - config.filter_weight) * ranks + config.filter_weight * heard_cells
    window = config.window_influence
    ranks = ranks * (1 - window) + _hann(config.grid_cells) * window
    usable = np.isfinite(ranks) & np.isfinite(offsets).all(0) & (offsets[2:] > 0).all(0)
    if not usable.any():
        return Decoded(old, 0.0, None, offsets, scores, penalties, ranks)
    best = int(np.argmax(np.where(usable, ranks, -np.inf)))
    rate = float(penalties[best] * scores[best] * config.size_rate)
    if config.clip_rate:
        rate = min(max(rate, 0.0), 1.0)
    found, heard = offsets[:, best].copy(), 0.0
    if response is not None:
        *peak, height = peak_near(response, float(found[0]), float(found[1]))
        # The less the filter is sure, the less it moves the box.
        share = config.filter_share * min(max(height / CLEAR_RESPONSE, 0.0), 1.0)
        found[:2] += share * (np.array(peak) - found[:2])
        heard = float(sample_response(response, found[:1], found[1:2])[0])
    box = _smoothed(old, found / scale, rate, frame_wh_px, config.min_size_px)
    centre_px = (float(found[0]), float(found[1]))
    return Decoded(box, float(scores[best]), best, offsets, scores, penalties, ranks, centre_px, heard)


def decode_offsets(loc: Array, config: TrackerConfig) -> Array:
    """Tanh-coded distances (4, 11, 11) to (4, 121): centre offset x, y from the patch centre, w, h, patch px."""
    half = config.search_px // 2
    coded = np.where(loc <= -1, -0.99, np.where(loc >= 1, 0.99, loc))
    left, right, top, bottom = (half * np.arctanh(coded)).reshape(4, -1)
    grid_x, grid_y = _grid(config.grid_cells, config.grid_stride_px)
    w, h = left + right, top + bottom
    return np.stack([grid_x - left + w / 2, grid_y - top + h / 2, w, h])


def _scores(cls1: Array, cls2: Array, config: TrackerConfig) -> Array:
    background, target = cls1.reshape(2, -1)
    probability = 1 / (1 + np.exp(background - target))  # softmax of two
    closeness = cls2.reshape(-1) if config.cls2_is_logit else 1 / (1 + np.exp(-cls2.reshape(-1)))
    return np.asarray(0.5 * (config.cls1_weight * probability + config.cls2_weight * closeness))


def _penalties(w: Array, h: Array, old_w: float, old_h: float, strength: float) -> Array:
    """At most 1, less where size or shape differ from the old ones (all in patch px)."""
    size_change = _change(_side(w, h) / _side(old_w, old_h))
    shape_change = _change(old_w / (old_h + 1e-5) / (w / (h + 1e-5)))
    return np.asarray(np.exp(-(shape_change * size_change - 1) * strength))


def _side(w: Array | float, h: Array | float) -> Array:
    context = (w + h) / 2
    return np.asarray(np.sqrt((w + context) * (h + context)))


def _change(ratio: Array) -> Array:
    return np.maximum(ratio, 1 / (ratio + 1e-5))


def _smoothed(old: Box, found: Array, rate: float, frame_wh_px: tuple[int, int], min_px: float) -> Box:
    x, y, w, h = (float(v) for v in found)
    frame_w, frame_h = frame_wh_px
    return Box(
        _clip(old.cx_px + x, 0, frame_w),  # the centre is not smoothed
        _clip(old.cy_px + y, 0, frame_h),
        _clip(old.w_px * (1 - rate) + w * rate, min_px, frame_w),
        _clip(old.h_px * (1 - rate) + h * rate, min_px, frame_h),
    )


def _clip(value: float, low: float, high: float) -> float:
    return max(low, min(value, high))


@lru_cache(maxsize=8)
def _grid(cells: int, stride_px: int) -> tuple[Array, Array]:
    """Cell centres' x and y offsets from the patch centre, row by row, in px."""
    axis = stride_px * (np.arange(cells, dtype=np.float64) - cells // 2)
    x, y = np.meshgrid(axis, axis)
    return x.ravel(), y.ravel()


@lru_cache(maxsize=8)
def _hann(cells: int) -> Array:
    window = np.hanning(cells)
    return np.asarray(np.outer(window, window).ravel())

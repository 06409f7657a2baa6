"""One-pass evaluation as the benchmarks compute it: success and precision from per-frame boxes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SUCCESS_THRESHOLDS = np.linspace(0, 1, 21)  # IoU > t, strictly
PRECISION_PX = 20.0
PRECISION_THRESHOLDS_PX = np.arange(51.0)  # centre error <= t


class ScoreError(ValueError):
    """Results that do not belong to the ground truth; one line that says how."""


@dataclass(frozen=True, slots=True)
class Score:
    """auc: area under the success curve. precision: share of frames with centre error <= 20 px.

    *_valid: the same over the frames only where the target is there, the honest figure; without the suffix
    an absent frame counts as the benchmark's own code counts it (a miss in success, a hit in precision).
    """

    auc: float
    precision: float
    auc_valid: float
    precision_valid: float


def fill_invalid(boxes_xywh: Array) -> Array:
    """Rows that are NaN or have no area are replaced by the row before."""
    boxes = np.array(boxes_xywh, float)
    for i in range(1, len(boxes)):
        if not np.isfinite(boxes[i]).all() or boxes[i, 2] <= 0 or boxes[i, 3] <= 0:
            boxes[i] = boxes[i - 1]
    return boxes


def overlaps(a_xywh: Array, b_xywh: Array) -> Array:
    """Intersection over union of boxes (N,4), row by row; -1 where b is absent."""
    left_top = np.maximum(a_xywh[:, :2], b_xywh[:, :2])
    right_bottom = np.minimum(a_xywh[:, :2] + a_xywh[:, 2:], b_xywh[:, :2] + b_xywh[:, 2:])
    inter = np.prod(np.clip(right_bottom - left_top, 0, None), axis=1)
    union = np.prod(a_xywh[:, 2:], axis=1) + np.prod(b_xywh[:, 2:], axis=1) - inter
    return np.where(np.isnan(b_xywh).any(1), -1.0, inter / np.maximum(union, 1e-12))


def centre_errors_px(a_xywh: Array, b_xywh: Array) -> Array:
    """Distance of centres (N,), px; -1 where b is absent."""
    gap = (a_xywh[:, :2] + a_xywh[:, 2:] / 2) - (b_xywh[:, :2] + b_xywh[:, 2:] / 2)
    return np.where(np.isnan(b_xywh).any(1), -1.0, np.hypot(gap[:, 0], gap[:, 1]))


@dataclass(frozen=True, slots=True)
class Curves:
    """Shares of frames: success (21,) over SUCCESS_THRESHOLDS, precision (51,) over PRECISION_THRESHOLDS_PX."""

    success: Array
    precision: Array


def prepared(boxes_xywh: Array, truth_xywh: Array) -> tuple[Array, Array]:
    """Boxes and truth (N,4) as they are compared: first box the truth's, invalid rows filled.

    Raises ScoreError when the lengths differ.
    """
    boxes, truth = fill_invalid(boxes_xywh), np.asarray(truth_xywh, float)
    if boxes.shape != truth.shape:
        raise ScoreError(f"{len(boxes)} result boxes against {len(truth)} rows of ground truth")
    boxes[0] = truth[0]
    return boxes, truth


def curves(boxes_xywh: Array, truth_xywh: Array) -> Curves:
    """Success and precision curves of one sequence over all frames, as the benchmarks plot them."""
    boxes, truth = prepared(boxes_xywh, truth_xywh)
    iou, error = overlaps(boxes, truth), centre_errors_px(boxes, truth)
    return Curves(
        (iou[None, :] > SUCCESS_THRESHOLDS[:, None]).mean(1),
        (error[None, :] <= PRECISION_THRESHOLDS_PX[:, None]).mean(1),
    )


def mean_curves(each: Iterable[Curves]) -> Curves:
    """Plain mean over sequences."""
    rows = list(each)
    return Curves(np.mean([c.success for c in rows], axis=0), np.mean([c.precision for c in rows], axis=0))


def score(boxes_xywh: Array, truth_xywh: Array) -> Score:
    """Score of one sequence. Both (N,4) x, y, w, h px; NaN rows of the truth mean absent.

    The first frame's result is taken as the truth. Raises ScoreError when the lengths differ.
    """
    boxes, truth = prepared(boxes_xywh, truth_xywh)
    there = ~np.isnan(truth).any(1)
    whole, valid = curves(boxes, truth), curves(boxes[there], truth[there])
    at = int(PRECISION_PX)
    return Score(
        float(whole.success.mean()),
        float(whole.precision[at]),
        float(valid.success.mean()),
        float(valid.precision[at]),
    )


def mean_score(scores: Iterable[Score]) -> Score:
    """Plain mean over sequences."""
    rows = np.array([(s.auc, s.precision, s.auc_valid, s.precision_valid) for s in scores])
    return Score(*(float(v) for v in rows.mean(0)))

"""Losses of the tracker (the paper's L_cls1, L_cls2, L_loc and their weighted sum)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from tracker.train.labels import FIRST_PX, GRID, HALF_PX, STRIDE_PX

LOC_WEIGHT = 2.4
CLS_WEIGHT = 1.0
EDGE_WEIGHT = 2.5
TARGET_SIDE_PX = 64.0  # of a target in its search patch


class Losses(NamedTuple):
    """Scalars; total = 2.4 loc + 1.0 (cls1 + cls2)."""

    total: Tensor
    cls1: Tensor
    cls2: Tensor
    loc: Tensor


def tracking_losses(
    loc: Tensor,
    cls1: Tensor,
    cls2: Tensor,
    target_cls1: Tensor,
    target_loc: Tensor,
    target_cls2: Tensor,
    loc_weight: Tensor,
) -> Losses:
    """All losses of a batch.

    loc (B, 4, 11, 11), cls1 (B, 2, 11, 11), cls2 (B, 1, 11, 11) from the network; targets as
    tracker.train.labels.Labels, stacked: cls1, cls2 and loc_weight (B, 1, 11, 11), loc (B, 4, 11, 11).
    """
    one = cls1_loss(cls1, target_cls1)
    two = functional.binary_cross_entropy_with_logits(cls2.flatten(), target_cls2.flatten())
    box = loc_loss(loc, target_loc, loc_weight)
    return Losses(LOC_WEIGHT * box + CLS_WEIGHT * (one + two), one, two, box)


def cls1_loss(logits: Tensor, target: Tensor) -> Tensor:
    """Half the mean loss of target cells plus half that of background cells; cells below 0 do not count."""
    log_probability = functional.log_softmax(logits, 1)  # (B, 2, 11, 11)
    labels = target[:, 0]  # (B, 11, 11)
    positive, negative = labels == 1, labels == 0
    return 0.5 * (_masked_mean(-log_probability[:, 1], positive) + _masked_mean(-log_probability[:, 0], negative))


def loc_loss(loc: Tensor, target: Tensor, weight: Tensor) -> Tensor:
    """Mean of 1 - IoU of the decoded boxes, weighted per cell."""
    weights = weight.flatten()  # (B*121,)
    losses = 1 - _iou(decode_corners(loc), decode_corners(target)).flatten()  # (B*121,)
    return (losses * weights).sum() / weights.sum().clamp(min=1e-6)


def edge_loss(loc: Tensor, target: Tensor, weight: Tensor) -> Tensor:
    """Mean error of the decoded boxes' edges, in sides of a 64 px target, and half that of their log sides.

    Not the authors': IoU alone teaches size and place slowly. Shapes as loc_loss.
    """
    found, wanted = decode_corners(loc), decode_corners(target)
    edges = (found - wanted).abs().mean(-1) / TARGET_SIDE_PX  # (B, 121)
    sides = (_log_sides(found) - _log_sides(wanted)).abs().mean(-1)  # (B, 121)
    weights = weight.flatten(1)
    return ((edges + 0.5 * sides) * weights).sum() / weights.sum().clamp(min=1e-6)


def _log_sides(corners: Tensor) -> Tensor:
    return (corners[..., 2:] - corners[..., :2]).clamp(min=2).log()  # (B, 121, 2)


def decode_corners(loc: Tensor) -> Tensor:
    """Tanh-coded distances (B, 4, 11, 11) to corners x1, y1, x2, y2 (B, 121, 4) in px of the 287 px patch."""
    coded = torch.where(loc <= -1, -0.99, torch.where(loc >= 1, 0.99, loc))
    left, right, top, bottom = (torch.atanh(coded) * HALF_PX).flatten(2).unbind(1)  # 4 x (B, 121)
    cells = FIRST_PX + STRIDE_PX * torch.arange(GRID, device=loc.device, dtype=loc.dtype)
    y, x = (grid.flatten() for grid in torch.meshgrid(cells, cells, indexing="ij"))  # 2 x (121,)
    return torch.stack([x - left, y - top, x + right, y + bottom], -1)  # (B, 121, 4)


def _iou(a: Tensor, b: Tensor) -> Tensor:
    size = (torch.minimum(a[..., 2:], b[..., 2:]) - torch.maximum(a[..., :2], b[..., :2])).clamp(min=0)
    inter = size.prod(-1)  # (B, 121)
    union = (a[..., 2:] - a[..., :2]).prod(-1) + (b[..., 2:] - b[..., :2]).prod(-1) - inter
    return inter / union.clamp(min=1e-6)  # a turned-over prediction has no overlap, not a negative one


def _masked_mean(values: Tensor, mask: Tensor) -> Tensor:
    return (values * mask).sum() / mask.sum().clamp(min=1)

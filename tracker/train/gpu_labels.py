"""tracker.train.labels.make_labels for a whole batch of boxes, on the boxes' device."""

from __future__ import annotations

import torch
from torch import Tensor

from tracker.train.gpu_random import Dice
from tracker.train.labels import FIRST_PX, GRID, HALF_PX, STRIDE_PX


def batch_labels(boxes: Tensor, positive: Tensor, dice: Dice) -> dict[str, Tensor]:
    """Targets of boxes (B,4) x1,y1,x2,y2 in px of the 287 px patch, keyed as a batch's label_*.

    cls1, cls2, loc_weight (B,1,11,11), loc (B,4,11,11); background everywhere where not positive (B,).
    """
    cell = ((boxes - FIRST_PX) / STRIDE_PX).clamp(0, GRID - 1).long()  # counted from the lower neighbour
    x1, y1, x2, y2 = (v.view(-1, 1, 1) for v in cell.unbind(1))
    steps = torch.arange(GRID, device=boxes.device)
    column, row = steps[None, None, :], steps[None, :, None]
    width, height = x2 - x1 + 1, y2 - y1 + 1
    # float64, as the reference: cells lie exactly on the radius
    distance = 16.0 * ((row - (y1 + y2) / 2).double() ** 2 + (column - (x1 + x2) / 2).double() ** 2)
    spread = ((width // 2 + height // 2) * 4).double()
    weight = _bump(distance, spread / 1.5)
    best = weight > 0.8
    weight = weight.masked_fill(_some(best, best.sum((1, 2)) // 4, dice), 1.5)
    quarter_w, quarter_h = width // 4, height // 4
    ring = _between(column, x1 - quarter_w, x2 + quarter_w) & _between(row, y1 - quarter_h, y2 + quarter_h)
    target = _between(column, x1 + quarter_w, x2 - quarter_w) & _between(row, y1 + quarter_h, y2 - quarter_h)
    background = _some(~ring, (target.sum((1, 2)) * 2.5).long(), dice)
    cls1 = torch.full(ring.shape, -1.0, device=boxes.device)
    cls1 = cls1.masked_fill(ring, -2.0).masked_fill(target, 1.0).masked_fill(background, 0.0)
    there = positive.view(-1, 1, 1)
    return {
        "label_cls1": (cls1 * there)[:, None],
        "label_loc": _distances(boxes),
        "label_cls2": (_bump(distance, spread / 1.2) * there)[:, None],
        "label_loc_weight": (weight * there)[:, None],
    }


def _between(steps: Tensor, low: Tensor, high: Tensor) -> Tensor:
    return (steps >= low) & (steps <= high)


def _some(cells: Tensor, count: Tensor, dice: Dice) -> Tensor:
    """count (B,) of the marked cells (B,11,11), or all where there are fewer; without replacement."""
    key = dice.uniform(0, 1, len(cells), GRID * GRID).masked_fill(~cells.flatten(1), 2.0)
    rank = key.argsort(1).argsort(1)
    return (rank < count[:, None]).view_as(cells) & cells


def _distances(boxes: Tensor) -> Tensor:
    cells = FIRST_PX + STRIDE_PX * torch.arange(GRID, device=boxes.device, dtype=torch.float32)
    x1, y1, x2, y2 = (v[:, None, None] for v in boxes.unbind(1))
    x, y = cells[None, None, :].expand(1, GRID, GRID), cells[None, :, None].expand(1, GRID, GRID)
    return torch.tanh(torch.stack([x - x1, x2 - x, y - y1, y2 - y], 1) / HALF_PX)


def _bump(distance: Tensor, radius: Tensor) -> Tensor:
    """1 at the middle falling to 0 at the last cell inside the radius; the middle alone if none is inside."""
    low = distance.amin((1, 2), keepdim=True)
    inside = (distance < radius * radius) | (distance == low)
    high = distance.masked_fill(~inside, -1.0).amax((1, 2), keepdim=True)
    return (1 - (distance - low) / (high - low + 1e-4)).masked_fill(~inside, 0.0).float()

"""The backbone's own lesson: a plain correlation response that peaks on the target and nowhere else."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

STRIDE_PX, CELLS = 8, 21


class SiameseResponse(nn.Module):
    """Response maps of layers 4 and 5 of every template against every search patch of a batch.

    The scale and bias are learned; they belong to training and are thrown away with it.
    """

    def __init__(self, channels: tuple[int, int]) -> None:
        super().__init__()
        sizes = (channels[0] * 64, channels[1] * 36)
        self.log_scale = nn.Parameter(torch.tensor([math.log(0.2 / math.sqrt(n)) for n in sizes]))
        self.bias = nn.Parameter(torch.zeros(2))

    def forward(self, search: tuple[Tensor, Tensor], template: tuple[Tensor, Tensor]) -> Tensor:
        """Features of both to (2, B searches, B templates, 21, 21)."""
        maps = [functional.conv2d(x, z) for x, z in zip(search, template, strict=True)]
        scale = self.log_scale.exp()
        return torch.stack([m.float() * scale[i] + self.bias[i] for i, m in enumerate(maps)])


def response_labels(box: Tensor, radius_px: float = 14.0) -> Tensor:
    """1 within radius of the box's centre, else 0: (B, 21, 21) of boxes x1,y1,x2,y2 in search px."""
    offset = (torch.arange(CELLS, device=box.device) - CELLS // 2) * float(STRIDE_PX)
    cx = (box[:, 0] + box[:, 2]) / 2 - 143
    cy = (box[:, 1] + box[:, 3]) / 2 - 143
    distance = torch.hypot(offset[None, None, :] - cx[:, None, None], offset[None, :, None] - cy[:, None, None])
    nearest = distance.flatten(1).amin(1)[:, None, None]
    return (distance <= radius_px).float().maximum((distance <= nearest).float())


def siamese_loss(responses: Tensor, box: Tensor, positive: Tensor, cross_weight: float, hard: int = 40) -> Tensor:
    """Balanced cross-entropy on each pair's own map, hardest cells first, plus cross-batch negatives.

    Every other template of the batch must stay silent on a search patch: softplus of its strongest cells.
    """
    n = responses.shape[1]
    own = responses[:, torch.arange(n), torch.arange(n)]  # (2, B, 21, 21)
    label = response_labels(box) * positive[:, None, None]
    weight = label[None] / label.sum().clamp(min=1)
    pull = (functional.softplus(-own) * weight).sum((1, 2, 3)).mean()
    rivals = own.masked_fill(label[None] > 0, -30).flatten(2).topk(hard, 2).values
    push = functional.softplus(rivals).mean()
    strongest = responses.flatten(3).topk(4, 3).values.mean(3)  # (2, B, B)
    off = ~torch.eye(n, dtype=torch.bool, device=responses.device)
    cross = functional.softplus(strongest[:, off]).mean()
    return 0.5 * pull + 0.5 * push + cross_weight * cross

"""Depth-wise cross-correlation and the reduction after it: the similarity maps M_s^4, M_s^5, M_t^5."""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional


def correlate(search: Tensor, template: Tensor) -> Tensor:
    """Each template channel (B, C, h, w) slid over the same channel of the search features (B, C, H, W).

    Returns (B, C, H-h+1, W-w+1), neither scaled nor normalised. A batch runs as groups of one convolution.
    """
    batch, channels = search.shape[:2]
    flat = search.reshape(1, batch * channels, *search.shape[2:])  # (1, B*C, H, W)
    kernels = template.reshape(batch * channels, 1, *template.shape[2:])  # (B*C, 1, h, w)
    out = functional.conv2d(flat, kernels, groups=batch * channels)  # (1, B*C, H', W')
    return out.reshape(batch, channels, *out.shape[2:])  # (B, C, H', W')


def reduction(channels: int, hidden: int) -> nn.Sequential:
    """Correlation map (B, C, 21, 21) to similarity map (B, hidden, 11, 11)."""
    return nn.Sequential(
        nn.Conv2d(channels, hidden, 3, stride=2, padding=1, bias=False),
        nn.BatchNorm2d(hidden),
        nn.ReLU(inplace=True),
    )

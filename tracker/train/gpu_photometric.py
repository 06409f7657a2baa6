"""What light, lens, sensor and codec do, on batches (N,3,H,W) BGR 0..1: tracker.train.photometric, vectorised."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from tracker.train.gpu_random import Dice

BLUR_PX = 9
COARSEST_FRAC = 0.2
COARSE_STEPS = 64
BLOCK_PX = 8
# Quantisation of luminance and chrominance at quality 50 (ITU-T T.81, annex K), rows of 8.
_LUMINANCE = """16 11 10 16 24 40 51 61 12 12 14 19 26 58 60 55 14 13 16 24 40 57 69 56 14 17 22 29 51 87 80 62
18 22 37 56 68 109 103 77 24 35 55 64 81 104 113 92 49 64 78 87 103 121 120 101 72 92 95 98 112 100 103 99"""
_CHROMINANCE = "17 18 24 47 99 99 99 99 18 21 26 66 99 99 99 99 24 26 56 99 99 99 99 99 47 66" + " 99" * 38
# Blue, green and red to Y, Cb, Cr of JPEG (ITU-T T.871), chroma round 0.
_TO_YCC = ((0.114, 0.587, 0.299), (0.5, -0.331264, -0.168736), (-0.081312, -0.418688, 0.5))


@dataclass(frozen=True)
class Tone:
    """Gamma (N,), gain and bias (N,3) of the channels, gain round middle grey."""

    gamma: Tensor
    gain: Tensor
    bias: Tensor

    @classmethod
    def drawn(cls, dice: Dice, size: int, strength: float = 1.0) -> Tone:
        """A light, exposure and colour cast."""
        gain = dice.normal(0.18 * strength, size, 1) + dice.normal(0.05 * strength, size, 3)
        bias = dice.normal(0.05 * strength, size, 1) + dice.normal(0.015 * strength, size, 3)
        return cls(dice.normal(0.15 * strength, size).exp(), gain.exp(), bias)

    def __call__(self, pictures: Tensor) -> Tensor:
        """pictures (N,3,...) in another light."""
        shape = (-1, 3) + (1,) * (pictures.ndim - 2)
        gamma = self.gamma.view(-1, *(1,) * (pictures.ndim - 1))
        gain, bias = self.gain.view(shape), self.bias.view(shape)
        return ((pictures**gamma).mul_(gain).add_(bias + 0.5 - 0.5 * gain)).clamp_(0, 1)


def grey(patches: Tensor) -> Tensor:
    """Without colour, still three channels."""
    light = patches[:, 0] * _TO_YCC[0][0] + patches[:, 1] * _TO_YCC[0][1] + patches[:, 2] * _TO_YCC[0][2]
    return light[:, None].expand_as(patches)


def haze(patches: Tensor, level: Tensor) -> Tensor:
    """Towards a light grey by level (N,), 0..1."""
    level = level.view(-1, 1, 1, 1)
    return patches * (1 - level) + level * (190 / 255)


def motion_blur(patches: Tensor, length_px: Tensor, angle_rad: Tensor) -> Tensor:
    """Straight smears of the lengths (N,), up to 9 px."""
    reach = torch.arange(BLUR_PX, device=patches.device) - BLUR_PX // 2
    c, s = angle_rad.cos().view(-1, 1, 1), angle_rad.sin().view(-1, 1, 1)
    along, across = c * reach + s * reach[:, None], c * reach[:, None] - s * reach
    half = length_px.view(-1, 1, 1) / 2
    kernel = (half + 0.5 - along.abs()).clamp(0, 1) * (1 - across.abs()).clamp(min=0)
    kernel = kernel / kernel.sum((1, 2), keepdim=True)
    n, _, h, w = patches.shape
    flat = functional.pad(patches, (BLUR_PX // 2,) * 4, mode="reflect").flatten(0, 1)[None]
    return functional.conv2d(flat, kernel.repeat_interleave(3, 0)[:, None], groups=3 * n).view(n, 3, h, w)


def coarsen(patches: Tensor, factor: Tensor) -> Tensor:
    """Down to the factors (N,) of their size and up again: objects of few native pixels."""
    step = ((factor - COARSEST_FRAC) / (1 - COARSEST_FRAC) * (COARSE_STEPS - 1)).round().long()
    matrix = _coarsening(patches.shape[-1], patches.device)[step.clamp(0, COARSE_STEPS - 1)][:, None]
    return matrix @ patches @ matrix.transpose(2, 3)


@cache
def _coarsening(side_px: int, device: torch.device) -> Tensor:
    """Down and up along one axis as matrices (steps, side, side): OpenCV's own, applied to the unit matrix."""
    unit, bank = np.eye(side_px, dtype=np.float32), []
    for factor in np.linspace(COARSEST_FRAC, 1, COARSE_STEPS):
        small = cv2.resize(unit, (side_px, max(8, round(side_px * factor))), interpolation=cv2.INTER_AREA)
        bank.append(cv2.resize(small, (side_px, side_px), interpolation=cv2.INTER_LINEAR))
    return torch.from_numpy(np.stack(bank)).to(device)


def compress(patches: Tensor, quality: Tensor) -> Tensor:
    """Block quantisation as a video link shows it: JPEG's for qualities (N,), chroma at half resolution."""
    side = patches.shape[-1]
    pad = -side % (2 * BLOCK_PX)
    to_ycc, to_bgr = _colour_matrices(patches.device)
    ycc = torch.einsum("oc,nchw->nohw", to_ycc, functional.pad(patches, (0, pad, 0, pad), mode="replicate"))
    scale = torch.where(quality < 50, 5000 / quality, 200 - 2 * quality).view(-1, 1, 1, 1, 1, 1) / 100
    light, colour = (_table(t, patches.device) * scale for t in (_LUMINANCE, _CHROMINANCE))
    y = _quantised(ycc[:, :1] - 128 / 255, light) + 128 / 255
    chroma = _quantised(functional.avg_pool2d(ycc[:, 1:], 2), colour)
    chroma = functional.interpolate(chroma, scale_factor=2, mode="bilinear", align_corners=False)
    bgr = torch.einsum("co,nohw->nchw", to_bgr, torch.cat([y, chroma], 1))
    return bgr[..., :side, :side].clamp(0, 1)


def _quantised(planes: Tensor, steps: Tensor) -> Tensor:
    """Planes (N,C,H,W) whose 8x8 blocks are rounded in frequency; steps in grey levels, last axes 8 and 8."""
    steps = steps.round().clamp(1, 255) / 255
    blocks = planes.unflatten(3, (-1, BLOCK_PX)).unflatten(2, (-1, BLOCK_PX)).transpose(3, 4)
    basis = _cosines(planes.device)
    rounded = ((basis @ blocks @ basis.T) / steps).round() * steps
    return (basis.T @ rounded @ basis).transpose(3, 4).flatten(4, 5).flatten(2, 3)


@cache
def _colour_matrices(device: torch.device) -> tuple[Tensor, Tensor]:
    """BGR to YCbCr and back, (3,3) each."""
    forth = np.array(_TO_YCC)
    return tuple(torch.from_numpy(m.astype(np.float32)).to(device) for m in (forth, np.linalg.inv(forth)))


@cache
def _cosines(device: torch.device) -> Tensor:
    """The orthonormal DCT-II of 8 points."""
    k, n = np.mgrid[:BLOCK_PX, :BLOCK_PX]
    basis = np.cos(math.pi * (2 * n + 1) * k / (2 * BLOCK_PX)) * math.sqrt(2 / BLOCK_PX)
    basis[0] /= math.sqrt(2)
    return torch.from_numpy(basis.astype(np.float32)).to(device)


@cache
def _table(text: str, device: torch.device) -> Tensor:
    return torch.tensor([float(v) for v in text.split()], device=device).view(BLOCK_PX, BLOCK_PX)

"""A discriminative correlation filter on the backbone's features, learned while tracking.

The network knows objects in general; this filter learns, from the frames of this very track, what tells the
target from its own surroundings. Ridge regression of a Gaussian peak (Bolme's MOSSE, Henriques' KCF), here in
exact normal equations on few principal components, so that what the first frame taught keeps its weight for
good and the filter cannot drift away from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

STRIDE_PX = 8  # of the backbone
TARGET_WEIGHT = 3.0  # how much more the cells of the peak count than those of the surroundings
PEAK_REACH_PX = 16.0  # how far from the network's centre the filter's peak is looked for
PEAK_STEP_PX = 2.0
REGION = 22  # cells in the middle of the search patch that the filter sees: all that the heads can point at

Response = NDArray[np.float32]
Places = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FilterConfig:
    """components: of the features that are kept. kernel: side of the filter, cells of 8 patch px.

    peak_cells: standard deviation of the wanted peak. ridge: part of the mean power added to the diagonal.
    rate: weight of a new frame against all later ones; anchor: weight of the first frame beside them.
    """

    components: int = 24
    kernel: int = 5
    peak_cells: float = 0.9
    ridge: float = 0.03
    rate: float = 0.02
    anchor: float = 0.3


class CorrelationFilter:
    """Learned from the first search patch with the target in its middle, then asked and taught.

    All features are (1, C, H, W) of one layer of a search patch; places are px of the patch from its middle.
    """

    def __init__(self, features: Tensor, config: FilterConfig) -> None:
        self.config = config
        x = _middle(features).flatten(1)  # (C, H*W)
        self._mean = x.mean(1, keepdim=True)  # (C, 1)
        values, vectors = torch.linalg.eigh((x - self._mean) @ (x - self._mean).T / x.shape[1])
        kept = min(config.components, len(values))
        spread = values[-kept:].mean().clamp(min=1e-12).sqrt()
        self._basis = vectors[:, -kept:].T / spread  # (K, C)
        power, wanted = self._equations(self.reduce(features), (0.0, 0.0))
        self._first = power, wanted
        self._power, self._wanted = power, wanted
        self._weights = self._solved()

    def reduce(self, features: Tensor) -> Tensor:
        """The filter's own view of the features (K, 22, 22): principal components, of near unit length per cell."""
        middle = _middle(features)
        x = self._basis @ (middle.flatten(1) - self._mean)  # (K, H*W)
        length = x.norm(dim=0, keepdim=True)  # (1, H*W)
        reduced: Tensor = x / (length + 0.3 * length.mean())
        return reduced.view(-1, *middle.shape[1:])

    def response(self, reduced: Tensor) -> Response:
        """About 1 where the target's centre is, about 0 elsewhere: (22, 22)."""
        kernel = self.config.kernel
        weights = self._weights.view(1, -1, kernel, kernel)
        return np.asarray(functional.conv2d(reduced[None], weights, padding=kernel // 2)[0, 0].cpu().numpy())

    def learn(self, reduced: Tensor, centre_px: tuple[float, float], frames: int = 1) -> None:
        """Take in a frame whose target lies at centre_px; frames: how many of its kind it stands for."""
        power, wanted = self._equations(reduced, centre_px)
        rate = 1 - (1 - self.config.rate) ** frames
        self._power = torch.lerp(self._power, power, rate)
        self._wanted = torch.lerp(self._wanted, wanted, rate)
        self._weights = self._solved()

    def forget(self) -> None:
        """Back to what the first frame taught."""
        self._power, self._wanted = self._first
        self._weights = self._solved()

    def _equations(self, reduced: Tensor, centre_px: tuple[float, float]) -> tuple[Tensor, Tensor]:
        """The frame's part of the normal equations: (D, D) and (D,), D = components * kernel^2."""
        label = gaussian_label(reduced.shape[1], reduced.shape[2], centre_px, self.config.peak_cells, reduced.device)
        weight = 1 + TARGET_WEIGHT * label  # (H*W,)
        kernel = self.config.kernel
        x = functional.unfold(reduced[None], kernel, padding=kernel // 2)[0]  # (D, H*W)
        weighted = x * weight
        return weighted @ x.T, weighted @ label

    def _solved(self) -> Tensor:
        anchor = self.config.anchor
        power = self._power + anchor * self._first[0]
        wanted = self._wanted + anchor * self._first[1]
        ridge = self.config.ridge * power.diagonal().mean()
        factor = torch.linalg.cholesky(power + ridge * torch.eye(len(power), device=power.device))
        return torch.cholesky_solve(wanted[:, None], factor)[:, 0]


def _middle(features: Tensor) -> Tensor:
    """(1, C, H, W) to its middle (C, 22, 22), float32."""
    top, left = ((side - REGION) // 2 for side in features.shape[2:])
    return features[0, :, top : top + REGION, left : left + REGION].float()


def gaussian_label(
    height: int, width: int, centre_px: tuple[float, float], peak_cells: float, device: torch.device
) -> Tensor:
    """The wanted response (H*W,): 1 at centre_px (x, y from the patch's middle), falling off as a Gaussian."""
    x = (torch.arange(width, device=device) - (width - 1) / 2) * STRIDE_PX - centre_px[0]
    y = (torch.arange(height, device=device) - (height - 1) / 2) * STRIDE_PX - centre_px[1]
    squared = x[None, :] ** 2 + y[:, None] ** 2  # (H, W)
    return torch.exp(-0.5 * squared / (peak_cells * STRIDE_PX) ** 2).flatten()


def sample_response(response: Response, x_px: Places, y_px: Places) -> Places:
    """The response (H, W) at places (N,) px from the patch's middle, bicubic; 0 outside."""
    height, width = response.shape
    column = (x_px / STRIDE_PX + (width - 1) / 2).astype(np.float32)
    row = (y_px / STRIDE_PX + (height - 1) / 2).astype(np.float32)
    sampled = cv2.remap(response, column[None], row[None], cv2.INTER_CUBIC, borderMode=cv2.BORDER_CONSTANT)
    return np.asarray(sampled[0], np.float64)


def peak_near(response: Response, x_px: float, y_px: float) -> tuple[float, float, float]:
    """Place (x, y), px from the patch's middle, of the response's highest point within 16 px of (x, y); its height."""
    offsets = np.arange(-PEAK_REACH_PX, PEAK_REACH_PX + 1, PEAK_STEP_PX)
    x, y = (grid.ravel() for grid in np.meshgrid(x_px + offsets, y_px + offsets))
    near = np.hypot(x - x_px, y - y_px) <= PEAK_REACH_PX
    heights = np.where(near, sample_response(response, x, y), -np.inf)
    best = int(np.argmax(heights))
    return float(x[best]), float(y[best]), float(heights[best])

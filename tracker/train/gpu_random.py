"""Random numbers of a batch, drawn on the device that composes: no value ever waits for the host."""

from __future__ import annotations

import random

import torch
from torch import Tensor


class Dice:
    """Draws for a whole batch; deterministic for its seed on a given kind of device.

    Shares of a batch that cost much (a blur, an occluder) are drawn as a fixed number of its samples, known on
    the host, so that shapes need no look at the device.
    """

    def __init__(self, device: torch.device, seed: int) -> None:
        self.device = device
        self._generator = torch.Generator(device).manual_seed(seed)
        self._host = random.Random(seed)

    def uniform(self, low: float, high: float, *shape: int) -> Tensor:
        """Uniform in [low, high)."""
        return torch.rand(shape, generator=self._generator, device=self.device) * (high - low) + low

    def normal(self, std: float, *shape: int) -> Tensor:
        """Gaussian round 0."""
        return torch.randn(shape, generator=self._generator, device=self.device) * std

    def chance(self, probability: float, size: int) -> Tensor:
        """True with the probability, (size,) bool."""
        return torch.rand(size, generator=self._generator, device=self.device) < probability

    def below(self, count: Tensor | int, size: int) -> Tensor:
        """Whole numbers 0..count-1, (size,) int64; count may be a tensor (size,)."""
        u = torch.rand(size, generator=self._generator, device=self.device, dtype=torch.float64)
        return (u * count).long()

    def angle(self, size: int) -> Tensor:
        """Any direction, radians."""
        return self.uniform(-torch.pi, torch.pi, size)

    def some(self, share: float, size: int) -> Tensor:
        """Indices of about share * size of the batch's samples, without repetition, int64.

        Their number is rounded up or down at random, so that its mean is exact for any size.
        """
        count = min(size, int(share * size + self._host.random()))
        return torch.rand(size, generator=self._generator, device=self.device).argsort()[:count]

    def by_weight(self, cumulative: Tensor, size: int) -> Tensor:
        """Indices drawn by a cumulative table of probabilities that ends at 1."""
        u = torch.rand(size, generator=self._generator, device=self.device, dtype=torch.float64)
        return torch.searchsorted(cumulative, u).clamp(max=len(cumulative) - 1)

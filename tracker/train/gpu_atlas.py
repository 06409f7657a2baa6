"""All pictures and cut-out objects as one flat buffer of texels on the device that composes.

A texture is a picture at one level of its pyramid, or an object with its soft mask. Pictures of any size lie
one after the other without padding; square windows of them are gathered for a whole batch at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from torch import Tensor

TEXEL_BYTES = 4  # blue, green, red, alpha


@dataclass(frozen=True)
class Atlas:
    """texels (N,) int32 holding blue, green, red, alpha bytes; per texture offset, width and height, (T,) int64."""

    texels: Tensor
    offset: Tensor
    width: Tensor
    height: Tensor

    @property
    def bytes(self) -> int:
        """Memory of the texels."""
        return self.texels.numel() * TEXEL_BYTES

    def mirrored(self, texture: Tensor, left: Tensor, top: Tensor, side_px: int) -> Tensor:
        """Square windows (B,3,side,side), 0..1 BGR, mirrored where they leave the texture.

        texture, left, top: (B,) int64, texture number and px of the window's corner in it.
        """
        steps = torch.arange(side_px, device=texture.device)
        x = _mirror(left[:, None] + steps, self.width[texture, None])
        y = _mirror(top[:, None] + steps, self.height[texture, None])
        return self._gather(texture, x, y)[:, :3]

    def bounded(self, texture: Tensor, side_px: int) -> Tensor:
        """Whole textures (B,4,side,side), 0..1 BGR and alpha, at the window's corner; alpha 0 outside them."""
        steps = torch.arange(side_px, device=texture.device)
        width, height = self.width[texture, None], self.height[texture, None]
        window = self._gather(texture, torch.minimum(steps, width - 1), torch.minimum(steps, height - 1))
        inside = (steps < width)[:, None, :] & (steps < height)[:, :, None]
        window[:, 3] *= inside
        return window

    def _gather(self, texture: Tensor, x: Tensor, y: Tensor) -> Tensor:
        row = self.offset[texture, None] + y * self.width[texture, None]
        texel = self.texels[row[:, :, None] + x[:, None, :]]  # (B, side, side)
        channels = texel.view(torch.uint8).unflatten(2, (-1, TEXEL_BYTES))
        return channels.permute(0, 3, 1, 2).float().mul_(1 / 255)


def build_atlas(
    sizes: Sequence[tuple[int, int]],
    textures: Iterator[np.ndarray],
    device: torch.device,
    each: Callable[[], object] = lambda: None,
) -> Atlas:
    """Copy textures of the sizes (height, width) to the device one by one.

    textures: (h,w,3) or (h,w,4) uint8, in the order of sizes. each: called after every texture.
    """
    count = np.array([h * w for h, w in sizes], np.int64)
    offset = np.concatenate([[0], np.cumsum(count)])
    texels = torch.empty(int(offset[-1]), dtype=torch.int32, device=device)
    for i, picture in enumerate(textures):
        if picture.shape[2] == 3:
            picture = cv2.cvtColor(picture, cv2.COLOR_BGR2BGRA)
        flat = np.ascontiguousarray(picture).view(np.int32).reshape(-1)
        texels[offset[i] : offset[i + 1]] = torch.from_numpy(flat)
        each()
    height, width = np.array(sizes, np.int64).reshape(-1, 2).T
    table = (torch.from_numpy(np.ascontiguousarray(a)).to(device) for a in (offset[:-1], width, height))
    return Atlas(texels, *table)


def _mirror(position: Tensor, length: Tensor) -> Tensor:
    """Positions reflected into 0..length-1, the border itself not repeated."""
    period = (2 * (length - 1)).clamp(min=1)
    inside = torch.remainder(position, period)
    return torch.minimum(inside, period - inside).minimum(length - 1)

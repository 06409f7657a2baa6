"""Affine placing of a batch of textures into patches: tracker.train.warp.Pose, vectorised."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor
from torch.nn import functional


@dataclass(frozen=True)
class Poses:
    """Where anchors lie in their patches (x, y px), scales (patch px per picture px), turns; each (N,)."""

    x: Tensor
    y: Tensor
    scale_x: Tensor
    scale_y: Tensor
    angle_rad: Tensor
    shear: Tensor
    flip: Tensor  # bool

    def _each(self, change: object, other: Poses | None = None) -> Poses:
        names = [f.name for f in fields(self)]
        if other is None:
            return Poses(*(change(getattr(self, n)) for n in names))
        return Poses(*(change(getattr(self, n), getattr(other, n)) for n in names))

    def __getitem__(self, index: Tensor) -> Poses:
        return self._each(lambda a: a[index])

    def where(self, condition: Tensor, other: Poses) -> Poses:
        """These where the condition (N,) holds, else the other's."""
        return self._each(lambda a, b: torch.where(condition, a, b), other)

    def moved(self, dx: Tensor, dy: Tensor, zoom: Tensor | float = 1.0, turn_rad: Tensor | float = 0.0) -> Poses:
        """Shifted in the patch, zoomed and turned about the anchors."""
        return replace(
            self,
            x=self.x + dx,
            y=self.y + dy,
            scale_x=self.scale_x * zoom,
            scale_y=self.scale_y * zoom,
            angle_rad=self.angle_rad + turn_rad,
        )

    def towards(self, other: Poses, t: float) -> Poses:
        """The poses at share t of the way to the other's."""
        names = ("x", "y", "scale_x", "scale_y", "angle_rad")
        return replace(self, **{n: torch.lerp(getattr(self, n), getattr(other, n), t) for n in names})

    def linear(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """The four entries (N,) of turn x shear x scale x flip: picture px to patch px."""
        c, s = self.angle_rad.cos(), self.angle_rad.sin()
        along = torch.where(self.flip, -self.scale_x, self.scale_x)
        slant = self.shear * self.scale_y
        return c * along, c * slant - s * self.scale_y, s * along, s * slant + c * self.scale_y

    def inverse(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """The four entries (N,) that take patch px to picture px."""
        a, b, c, d = self.linear()
        determinant = a * d - b * c
        return d / determinant, -b / determinant, -c / determinant, a / determinant

    def sources(self, size_px: int) -> tuple[Tensor, Tensor]:
        """Picture px, relative to the anchor, of every patch pixel: x and y (N,size,size)."""
        a, b, c, d = (v[:, None, None] for v in self.inverse())
        steps = torch.arange(size_px, device=self.x.device, dtype=torch.float32)
        u = steps - self.x[:, None, None]  # (N, 1, size)
        v = steps[:, None] - self.y[:, None, None]  # (N, size, 1)
        return a * u + b * v, c * u + d * v

    def source_of(self, x: float, y: float) -> tuple[Tensor, Tensor]:
        """Picture px (N,), relative to the anchor, of one patch point."""
        a, b, c, d = self.inverse()
        u, v = x - self.x, y - self.y
        return a * u + b * v, c * u + d * v

    def boxes(self, hull: Tensor) -> Tensor:
        """x1, y1, x2, y2 in patch px (N,4) of hulls (N,K,2) given in picture px relative to the anchor."""
        a, b, c, d = (v[:, None] for v in self.linear())
        x = a * hull[..., 0] + b * hull[..., 1] + self.x[:, None]
        y = c * hull[..., 0] + d * hull[..., 1] + self.y[:, None]
        return torch.stack([x.amin(1), y.amin(1), x.amax(1), y.amax(1)], 1)


@dataclass(frozen=True)
class Waves:
    """A smooth bend of objects, a few long waves across each: what thin plates do, and known at every point.

    amplitude (N,2) and frequency (N,2,2), phase (N,2) in units of the object's own size (N,2) px.
    """

    amplitude: Tensor
    frequency: Tensor
    phase: Tensor
    size: Tensor

    def offset(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        """Where to look instead, as an addition to x and y (N,...) px relative to the object's middle."""
        shape = (-1,) + (1,) * (x.ndim - 1)
        u, v = x / self.size[:, 0].view(shape), y / self.size[:, 1].view(shape)
        wave = [
            self.amplitude[:, i].view(shape)
            * torch.sin(
                self.frequency[:, i, 0].view(shape) * u
                + self.frequency[:, i, 1].view(shape) * v
                + self.phase[:, i].view(shape)
            )
            * self.size[:, i].view(shape)
            for i in (0, 1)
        ]
        return wave[0], wave[1]

    def bent(self, hull: Tensor) -> Tensor:
        """Where points (N,K,2) of the object come to lie: q with q + offset(q) = point, by fixed-point steps."""
        x, y = hull.unbind(2)
        for _ in range(6):
            dx, dy = self.offset(x, y)
            x, y = hull[..., 0] - dx, hull[..., 1] - dy
        return torch.stack([x, y], 2)


def look_up(window: Tensor, x: Tensor, y: Tensor, outside: str) -> Tensor:
    """Windows (N,C,S,S) read bilinearly at px x, y (N,H,W) of them; outside: 'zeros' or 'reflection'."""
    side = window.shape[-1]
    grid = torch.stack([x, y], 3).mul_(2 / side).add_(1 / side - 1)
    return functional.grid_sample(window, grid, mode="bilinear", padding_mode=outside, align_corners=False)

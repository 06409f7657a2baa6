"""Grounds and cut-out objects drawn into batches of patches by gathering and bilinear reading."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from tracker.train.compose import SEARCH_PX
from tracker.train.gpu_atlas import Atlas
from tracker.train.gpu_photometric import Tone
from tracker.train.gpu_pose import Poses, Waves, look_up
from tracker.train.gpu_things import SPRITE_PX, Things

SEARCH_WINDOW_PX, TEMPLATE_WINDOW_PX = 512, 256  # hold what such a patch shows of a level


@dataclass(frozen=True)
class Ground:
    """Windows of pictures, one a sample, from which the frames of a moment are read."""

    window: Tensor  # (B,3,S,S)
    corner: tuple[Tensor, Tensor]  # px of the level, (B,)
    anchor: Tensor  # (B,2) px of the picture: what the poses place
    shrink: Tensor  # (B,) picture px per px of the level

    @classmethod
    def of(cls, atlas: Atlas, levels: int, picture: Tensor, anchor: Tensor, poses: Poses, size_px: int) -> Ground:
        """The level nearest to the poses' scale and the part of it that a patch of size_px shows."""
        scale = (poses.scale_x * poses.scale_y).sqrt()
        level = ((scale <= 0.6).long() + (scale <= 0.3).long()).clamp(max=levels - 1)
        shrink = 2.0**level
        side = SEARCH_WINDOW_PX if size_px == SEARCH_PX else TEMPLATE_WINDOW_PX
        seen = poses.source_of((size_px - 1) / 2, (size_px - 1) / 2)
        corner = [((s + anchor[:, i] + 0.5) / shrink - side / 2).round() for i, s in enumerate(seen)]
        window = atlas.mirrored(picture * levels + level, corner[0].long(), corner[1].long(), side)
        return cls(window, (corner[0], corner[1]), anchor, shrink)

    def seen(self, poses: Poses, size_px: int) -> Tensor:
        """Patches (B,3,size,size) with the anchors placed so."""
        x, y = (
            # shrinking keeps the corners of pixels, so middles move by half of one
            (s + (self.anchor[:, i] + 0.5).view(-1, 1, 1)) / self.shrink.view(-1, 1, 1)
            - (self.corner[i] + 0.5).view(-1, 1, 1)
            for i, s in enumerate(poses.sources(size_px))
        )
        return look_up(self.window, x, y, "reflection")


@dataclass(frozen=True)
class Sprites:
    """Cut-out objects, one a row: premultiplied colours and alpha, read from the corner of their windows."""

    rows: Tensor | None  # (N,) samples of the batch they are drawn into, None = every one in order
    window: Tensor  # (N,4,S,S)
    corner: Tensor  # (N,2) the middle of the box in the sprite, picture px
    shrink: Tensor  # (N,2) sprite px per picture px
    bend: tuple[Tensor, Waves] | None = None  # which rows are bent, and how

    @classmethod
    def of(
        cls,
        atlas: Atlas,
        things: Things,
        first: int,
        thing: Tensor,
        opacity: Tensor,
        rows: Tensor | None = None,
        tone: Tone | None = None,
        order: Tensor | None = None,
        bend: tuple[Tensor, Waves] | None = None,
    ) -> Sprites:
        """Things' sprites (their textures start at `first`), in another tone and order (N,3) of channels."""
        window = atlas.bounded(first + thing, SPRITE_PX)
        colour = window[:, :3]
        if order is not None:
            colour = colour[torch.arange(len(thing), device=thing.device)[:, None], order]
        if tone is not None:
            colour = tone(colour)
        alpha = window[:, 3:] * opacity.view(-1, 1, 1, 1)
        return cls(rows, torch.cat([colour * alpha, alpha], 1), things.corner[thing], things.shrink[thing], bend)

    def paste(self, patches: Tensor, poses: Poses) -> Tensor:
        """Draw over the patches (B,3,size,size), in place; poses (N,) place the middles of the objects' boxes."""
        x, y = poses.sources(patches.shape[-1])
        if self.bend is not None:
            rows, waves = self.bend
            dx, dy = waves.offset(x[rows], y[rows])
            x, y = x.index_add_(0, rows, dx), y.index_add_(0, rows, dy)
        u, v = (
            (s + (self.corner[:, i] + 0.5).view(-1, 1, 1)) * self.shrink[:, i].view(-1, 1, 1) - 0.5
            for i, s in enumerate((x, y))
        )
        layer = look_up(self.window, u, v, "zeros")
        below = patches if self.rows is None else patches[self.rows]
        blend = torch.addcmul(below + layer[:, :3], below, layer[:, 3:], value=-1)
        return blend if self.rows is None else patches.index_copy_(0, self.rows, blend)

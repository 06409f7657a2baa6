"""Grader: similarity maps, learned positions, the cross transformer and the three prediction heads."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from tracker.configs import NetworkConfig
from tracker.network.backbone import Features
from tracker.network.correlation import correlate, reduction
from tracker.network.hift import HiFTTransformer
from tracker.network.lct import CrossTransformer

POSITIONS = 50  # rows of the authors' position tables; an 11x11 grid uses the first 11


class Predictions(NamedTuple):
    """What the network says of each of the 11x11 cells.

    loc (B, 4, 11, 11): tanh-coded distances to the box's left, right, top, bottom, in 143 px.
    cls1 (B, 2, 11, 11): background and target logits. cls2 (B, 1, 11, 11): closeness to the centre, a logit.
    """

    loc: Tensor
    cls1: Tensor
    cls2: Tensor


def tower(config: NetworkConfig, out_channels: int | None = None) -> nn.Sequential:
    """A row of 3x3 convolutions with GroupNorm and ReLU, closed by a plain one if out_channels is given."""
    hidden = config.hidden
    layers: list[nn.Module] = []
    for _ in range(config.head_convs):
        layers.append(nn.Conv2d(hidden, hidden, 3, padding=1))
        layers.append(nn.GroupNorm(config.group_norm_groups, hidden))
        layers.append(nn.ReLU(inplace=True))
    if out_channels is not None:
        layers.append(nn.Conv2d(hidden, out_channels, 3, padding=1))
    return nn.Sequential(*layers)


class Grader(nn.Module):
    """From features of search patch, template and latent frame to predictions. Names are the authors'.

    Three similarity maps go in. ClimRT: layers 4 and 5 of the search patch, layer 5 of the latent frame; HiFT:
    layers 3, 4 and 5 of the search patch. Among the ablations, LCT without ClimNet has the search patch's own
    layer 5 in the latent frame's place, and HiFT with ClimNet the latent frame's in its own layer 5's: the
    paper does not say how it joined the two, and its decoder's target is what both transformers have in common.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.variant = config.variant
        c3, c4, c5 = config.backbone_channels[2:]
        hidden = config.hidden
        self.conv1 = reduction(c3 if self.variant.is_hift else c4, hidden)
        self.conv2 = reduction(c5, hidden)
        self.conv3 = reduction(c4 if self.variant.is_hift else c5, hidden)
        self.row_embed = nn.Embedding(POSITIONS, hidden // 2)
        self.col_embed = nn.Embedding(POSITIONS, hidden // 2)
        nn.init.uniform_(self.row_embed.weight)
        nn.init.uniform_(self.col_embed.weight)
        self.transformer = HiFTTransformer(config) if self.variant.is_hift else CrossTransformer(config)
        self.convloc = tower(config, 4)
        self.convcls = tower(config)
        self.cls1 = nn.Conv2d(hidden, 2, 3, padding=1)
        self.cls2 = nn.Conv2d(hidden, 1, 3, padding=1)

    def similarity(self, search: Features, template: Features, latent5: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Similarity maps, each (B, hidden, 11, 11), before positions are added.

        Ms4, Ms5, Mt5 as the paper names them; for HiFT those of layers 3, 4 and 5.
        """
        target5 = latent5 if self.variant.uses_latent else search[-1]  # (B, c5, 26, 26)
        if self.variant.is_hift:
            m3 = self.conv1(correlate(search[0], template[0]))  # (B, hidden, 11, 11)
            m4 = self.conv3(correlate(search[1], template[1]))  # (B, hidden, 11, 11)
            return m3, m4, self.conv2(correlate(target5, template[2]))
        ms4 = self.conv1(correlate(search[0], template[0]))  # (B, hidden, 11, 11)
        ms5 = self.conv2(correlate(search[1], template[1]))  # (B, hidden, 11, 11)
        return ms4, ms5, self.conv3(correlate(target5, template[1]))

    def positions(self, height: int, width: int) -> Tensor:
        """Learned position map (1, hidden, H, W): the column's vector above the row's."""
        col = self.col_embed.weight[:width].T[:, None, :].expand(-1, height, -1)  # (hidden/2, H, W)
        row = self.row_embed.weight[:height].T[:, :, None].expand(-1, -1, width)  # (hidden/2, H, W)
        return torch.cat([col, row])[None]  # (1, hidden, H, W)

    def forward(self, search: Features, template: Features, latent5: Tensor) -> Predictions:
        """Features of search patch and template, layer 5 of the latent frame, to Predictions."""
        first, second, target = self.similarity(search, template, latent5)  # 3 x (B, hidden, 11, 11)
        pos = self.positions(*first.shape[2:])  # (1, hidden, 11, 11)
        if not self.variant.is_hift:  # HiFT gives its decoder's target no positions
            target = target + pos
        joined = self.transformer(first + pos, second + pos, target)  # (B, hidden, 11, 11)
        shared = self.convcls(joined)  # (B, hidden, 11, 11)
        return Predictions(self.convloc(joined), self.cls1(shared), self.cls2(shared))

"""HiFT's transformer, the baseline of the paper's ablations: layers 3 and 4 make the memory, layer 5 reads it.

All sequences are (B, S, C), S = 121 grid cells row by row, C = hidden channels.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from tracker.configs import NetworkConfig
from tracker.network.lct import CALID, Stage, as_maps, as_sequence, to_maps, to_sequence

DECODER_LAYERS = 2
SQUEEZE = 6  # the modulation's bottleneck: 192 -> 32 -> 192


class Modulation(nn.Module):
    """Weights each channel of one map by the means of another, as strongly as a learned gamma (0 at first) says."""

    def __init__(self, hidden: int) -> None:
        super().__init__()
        narrow = max(1, hidden // SQUEEZE)
        self.weigh = nn.Sequential(nn.Conv2d(hidden, narrow, 1), nn.ReLU(), nn.Conv2d(narrow, hidden, 1))
        self.gamma = nn.Parameter(torch.zeros(1))

    def forward(self, maps: Tensor, other: Tensor) -> Tensor:
        """Two maps (B, C, H, W) to one: the first, modulated."""
        weight = self.weigh(other.mean((2, 3), keepdim=True))  # (B, C, 1, 1)
        return maps + self.gamma * weight * maps  # (B, C, H, W)


class HiFTEncoderLayer(nn.Module):
    """The layer-3 map looks where its sum with the layer-4 map looks alike, and is modulated by the latter.

    HiFT's text leaves open which map's means modulate: here those of layer 4, whose meaning layer 3 lacks.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        hidden = config.hidden
        self.legacy_layout = config.legacy_layout
        self.self_attn = nn.MultiheadAttention(hidden, config.heads, config.dropout, batch_first=True)
        self.modulation = Modulation(hidden)
        self.linear1 = nn.Linear(hidden, config.ffn)
        self.linear2 = nn.Linear(config.ffn, hidden)
        self.norm0 = nn.LayerNorm(hidden)
        self.norm1 = nn.LayerNorm(hidden)
        self.norm2 = nn.LayerNorm(hidden)

    def forward(self, m3: Tensor, m4: Tensor) -> Tensor:
        """Sequences (B, S, C) of layers 3 and 4, positions added, to the memory (B, S, C)."""
        side = math.isqrt(int(m3.shape[1]))
        query = self.norm0(m3 + m4)  # (B, S, C)
        s = self.norm1(m3 + self.self_attn(query, query, m3, need_weights=False)[0])  # (B, S, C)
        maps = [as_maps(sequence, side, side, self.legacy_layout) for sequence in (s, m4)]  # 2 x (B, C, H, W)
        s = as_sequence(self.modulation(*maps), self.legacy_layout)  # (B, S, C)
        return self.norm2(s + self.linear2(torch.relu(self.linear1(s))))  # (B, S, C)


class HiFTTransformer(nn.Module):
    """Encoder of one layer and decoder of two, with ordinary residuals: three maps in, one out."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.encoder = Stage([HiFTEncoderLayer(config)], config.hidden)
        self.decoder = Stage([CALID(config, residual=True) for _ in range(DECODER_LAYERS)], config.hidden)

    def forward(self, m3: Tensor, m4: Tensor, m5: Tensor) -> Tensor:
        """Maps (B, C, H, W) of layers 3 and 4, positions added, and of layer 5, without, to (B, C, H, W)."""
        memory = self.encoder(to_sequence(m3), to_sequence(m4))  # (B, S, C)
        return to_maps(self.decoder(to_sequence(m5), memory), *m3.shape[2:])  # (B, C, H, W)

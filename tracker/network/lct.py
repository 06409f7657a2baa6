"""The paper's cross transformer (LCT): LAEIE encoder and CALID decoder, one layer each.

LAEIE joins the similarity maps of layers 4 and 5 into a memory; CALID lets the latent map read that memory.
All sequences are (B, S, C), S = 121 grid cells row by row, C = hidden channels.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from tracker.configs import NetworkConfig


def to_sequence(maps: Tensor) -> Tensor:
    """(B, C, H, W) to (B, H*W, C)."""
    return maps.flatten(2).transpose(1, 2)


def to_maps(sequence: Tensor, height: int, width: int) -> Tensor:
    """(B, H*W, C) to (B, C, H, W)."""
    return sequence.transpose(1, 2).reshape(sequence.shape[0], -1, height, width)


def as_maps(sequence: Tensor, height: int, width: int, legacy_layout: bool) -> Tensor:
    """(B, H*W, C) to (B, C, H, W): properly, or as the authors' encoders see it.

    They view position-major memory as channel-major without permuting: their weights have learned it. Done per
    sample here, so a batch is the same as its samples one by one.
    """
    if not legacy_layout:
        return to_maps(sequence, height, width)  # (B, C, H, W)
    return sequence.reshape(sequence.shape[0], -1, height, width)  # (B, C, H, W), scrambled


def as_sequence(maps: Tensor, legacy_layout: bool) -> Tensor:
    """The way back from as_maps: (B, C, H, W) to (B, H*W, C)."""
    if not legacy_layout:
        return to_sequence(maps)
    return maps.reshape(maps.shape[0], -1, maps.shape[1])  # (B, S, C)


class LAEIE(nn.Module):
    """Encoder layer: layer-5 map, weighted per channel, asks the layer-4 map; a 1x1 conv fuses."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        hidden = config.hidden
        self.legacy_layout = config.legacy_layout
        self.self_attn = nn.MultiheadAttention(hidden, config.heads, config.dropout, batch_first=True)
        self.conv1 = nn.Sequential(nn.Conv2d(hidden, hidden, 1))
        self.conv2 = nn.Sequential(nn.Conv2d(2 * hidden, hidden, 1))
        self.linear1 = nn.Linear(hidden, config.ffn)
        self.linear2 = nn.Linear(config.ffn, hidden)
        self.norm1 = nn.LayerNorm(hidden)
        self.norm2 = nn.LayerNorm(hidden)

    def forward(self, m5: Tensor, m4: Tensor) -> Tensor:
        """Maps (B, C, H, W) of layers 5 and 4, positions added, to the memory (B, H*W, C)."""
        height, width = m5.shape[2:]
        pooled = m5.mean((2, 3), keepdim=True) + m4.amax((2, 3), keepdim=True)  # (B, C, 1, 1)
        weight = torch.sigmoid(self.conv1(pooled))  # (B, C, 1, 1)
        query = self.norm1(to_sequence(m5 + weight * m5))  # (B, S, C)
        key = to_sequence(m4)  # (B, S, C)
        attended = self.self_attn(query, key, key, need_weights=False)[0]  # (B, S, C)
        maps = [as_maps(sequence, height, width, self.legacy_layout) for sequence in (query, attended)]
        fused = torch.cat(maps, 1)  # (B, 2C, H, W)
        s = to_sequence(self.conv2(fused))  # (B, 2C, H, W) -> (B, S, C)
        return self.norm2(s + self.linear2(torch.relu(self.linear1(s))))  # (B, S, C)


class CALID(nn.Module):
    """Decoder layer: the latent map attends to itself, then reads the encoder's memory."""

    def __init__(self, config: NetworkConfig, residual: bool) -> None:
        """residual: whether the cross-attention has one; the authors' has not."""
        super().__init__()
        hidden = config.hidden
        self.residual = residual
        self.self_attn = nn.MultiheadAttention(hidden, config.heads, config.dropout, batch_first=True)
        self.multihead_attn = nn.MultiheadAttention(hidden, config.heads, config.dropout, batch_first=True)
        self.linear1 = nn.Linear(hidden, config.ffn)
        self.linear2 = nn.Linear(config.ffn, hidden)
        self.norm1 = nn.LayerNorm(hidden)
        self.norm2 = nn.LayerNorm(hidden)
        self.norm3 = nn.LayerNorm(hidden)

    def forward(self, latent: Tensor, memory: Tensor) -> Tensor:
        """Latent sequence and memory, both (B, S, C), to (B, S, C)."""
        t = self.norm1(latent + self.self_attn(latent, latent, latent, need_weights=False)[0])  # (B, S, C)
        read = self.multihead_attn(t, memory, memory, need_weights=False)[0]  # (B, S, C)
        t = self.norm2(t + read if self.residual else read)  # (B, S, C)
        return self.norm3(t + self.linear2(torch.relu(self.linear1(t))))  # (B, S, C)


class Stage(nn.Module):
    """Layers one after the other and the closing LayerNorm, nested as the authors' checkpoints name them."""

    def __init__(self, layers: list[nn.Module], hidden: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(layers)
        self.norm = nn.LayerNorm(hidden)

    def forward(self, a: Tensor, b: Tensor) -> Tensor:
        """(B, S, C) from the first layer's input and the one that every layer is given beside its own."""
        for layer in self.layers:
            a = layer(a, b)  # (B, S, C)
        return self.norm(a)  # (B, S, C)


class CrossTransformer(nn.Module):
    """Encoder and decoder together: three similarity maps in, one joined map out."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.encoder = Stage([LAEIE(config)], config.hidden)
        self.decoder = Stage([CALID(config, config.cross_attention_residual)], config.hidden)

    def forward(self, m4: Tensor, m5: Tensor, mt5: Tensor) -> Tensor:
        """Maps (B, C, H, W) of layer 4, layer 5 and the latent frame, positions added, to (B, C, H, W)."""
        memory = self.encoder(m5, m4)  # (B, S, C)
        decoded = self.decoder(to_sequence(mt5), memory)  # (B, S, C)
        return to_maps(decoded, *m4.shape[2:])  # (B, C, H, W)

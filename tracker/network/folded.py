"""ClimNet folded into 2-D convolutions: the same numbers to float rounding, sooner; for inference only.

With two moments, every map (B, C, 2, H, W) is kept as (B, 2C, H, W), channels [t0 | t1]. A convolution that
does not mix moments runs as two groups; one that does, as a dense convolution with block weights, which also
leaves out the taps that would only ever meet temporal padding.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from tracker.network.climnet import MOMENTS, ClimNet, Gate, GatedConv, GatedUpsampling, GhostConv, GSTCBlock, MSFusion


def per_moment(conv: nn.Conv3d) -> nn.Conv2d:
    """A (1, k, k) convolution as a 2-D one that treats both moments alike."""
    folded = nn.Conv2d(
        MOMENTS * conv.in_channels,
        MOMENTS * conv.out_channels,
        conv.kernel_size[1:],
        conv.stride[1:],
        conv.padding[1:],
        groups=MOMENTS * conv.groups,
        bias=False,
    )
    return _filled(folded, conv.weight[:, :, 0].repeat(MOMENTS, 1, 1, 1), None)


def across_moments(conv: nn.Conv3d, split: tuple[int, ...]) -> nn.Conv2d:
    """A (3, k, k) convolution as a dense 2-D one; split: channels of the input's parts, each [t0 | t1]."""
    w = conv.weight  # (out, in, 3, k, k)
    # Output moment t reads input moment s through tap s - t + 1.
    rows = [_interleave([w[:, :, s - t + 1] for s in range(MOMENTS)], split, 1) for t in range(MOMENTS)]
    bias = None if conv.bias is None else conv.bias.repeat(MOMENTS)
    inputs, outputs = MOMENTS * conv.in_channels, MOMENTS * conv.out_channels
    kernel, stride, padding = conv.kernel_size[1:], conv.stride[1:], conv.padding[1:]
    folded = nn.Conv2d(inputs, outputs, kernel, stride, padding, bias=bias is not None)
    return _filled(folded, torch.cat(rows, 0), bias)


def upsampling(conv: nn.ConvTranspose3d, split: tuple[int, ...]) -> nn.ConvTranspose2d:
    """The (3, 4, 4) transposed convolution as a 2-D one."""
    w = conv.weight  # (in, out, 3, 4, 4)
    # Input moment s writes output moment t through tap t - s + 1.
    columns = [_interleave([w[:, :, t - s + 1] for s in range(MOMENTS)], split, 0) for t in range(MOMENTS)]
    inputs, outputs = MOMENTS * conv.in_channels, MOMENTS * conv.out_channels
    folded = nn.ConvTranspose2d(inputs, outputs, conv.kernel_size[1:], conv.stride[1:], conv.padding[1:])
    return _filled(folded, torch.cat(columns, 1), conv.bias.repeat(MOMENTS))


def _interleave(moments: list[Tensor], split: tuple[int, ...], dim: int) -> Tensor:
    """Weights of both input moments in the order of an input made of parts, each [t0 | t1]."""
    parts = zip(*(w.split(split, dim) for w in moments), strict=True)
    return torch.cat([w for part in parts for w in part], dim)


def _filled(conv: nn.Conv2d, weight: Tensor, bias: Tensor | None) -> nn.Conv2d:
    with torch.no_grad():
        conv.weight.copy_(weight)
        if bias is not None:
            conv.bias.copy_(bias)
    return conv


def _means(x: Tensor, parts: int = 1) -> Tensor:
    """Means over both moments and all places: (B, parts * 2C, H, W) to (B, parts * C, 1, 1)."""
    means = x.mean((2, 3)).unflatten(1, (parts, MOMENTS, -1)).mean(2)  # (B, parts, C)
    return means.flatten(1)[..., None, None]


class FoldedGate(nn.Module):
    """The gate's factors from channel means."""

    def __init__(self, conv: nn.Conv3d) -> None:
        super().__init__()
        self.conv = _filled(nn.Conv2d(conv.in_channels, conv.out_channels, 1), conv.weight[:, :, 0], conv.bias)

    def forward(self, means: Tensor) -> Tensor:
        """(B, C, 1, 1) to factors (B, Cout, 1, 1)."""
        return torch.sigmoid(self.conv(means))


def folded_gate(gate: Gate) -> FoldedGate:
    """The folded form of a Gate."""
    return FoldedGate(gate.attn_layer[0])


def _both(factors: Tensor) -> Tensor:
    return factors.repeat(1, MOMENTS, 1, 1)  # (B, 2C, 1, 1)


class FoldedGhostConv(nn.Module):
    """GhostConv on [t0 | t1] channels."""

    def __init__(self, ghost: GhostConv) -> None:
        super().__init__()
        self.real = per_moment(ghost.primary_conv[0])
        self.cheap = per_moment(ghost.cheap_operation[0])
        temporal = ghost.temporalconv[0]
        half = ghost.primary_conv[0].out_channels
        if ghost.middle < 2 * half:  # the reference drops the last cheap channel: give it no weight
            whole = nn.Conv3d(2 * half, temporal.out_channels, (3, 1, 1), padding=(1, 0, 0), bias=False)
            missing = (0, 0, 0, 0, 0, 0, 0, 2 * half - ghost.middle)
            temporal = _filled(whole, functional.pad(temporal.weight, missing), None)
        self.temporal = across_moments(temporal, (half, half))

    def forward(self, x: Tensor) -> Tensor:
        """(B, 2*Cin, H, W) to (B, 2*Cout, H', W')."""
        real = torch.relu_(self.real(x))  # (B, 2*half, H', W')
        cheap = torch.relu_(self.cheap(real))  # (B, 2*half, H', W')
        return self.temporal(torch.cat([real, cheap], 1))  # (B, 2*Cout, H', W')


class FoldedGSTCBlock(nn.Module):
    """GSTCBlock on [t0 | t1] channels."""

    def __init__(self, block: GSTCBlock) -> None:
        super().__init__()
        self.conv1 = _space_time(block.conv1[0])
        self.conv2 = _space_time(block.conv2[0])
        self.shortcut = per_moment(block.downsample[0]) if len(block.downsample) else nn.Identity()
        self.gate = folded_gate(block.fg)

    def forward(self, x: Tensor) -> Tensor:
        """(B, 2*Cin, H, W) to (B, 2*Cout, H', W')."""
        y = self.conv2(torch.relu_(self.conv1(x))).add_(self.shortcut(x))  # (B, 2*Cout, H', W')
        return y.mul_(_both(self.gate(_means(y))))


def _space_time(conv: GhostConv | nn.Conv3d) -> nn.Module:
    return FoldedGhostConv(conv) if isinstance(conv, GhostConv) else across_moments(conv, (conv.in_channels,))


class FoldedGatedConv(nn.Module):
    """GatedConv, and the LeakyReLU that follows it, on [t0 | t1] channels."""

    def __init__(self, block: GatedConv, parts: int) -> None:
        super().__init__()
        conv = block.conv[0]
        self.conv = across_moments(conv, (conv.in_channels // parts,) * parts)
        self.gate = folded_gate(block.conv[1])

    def forward(self, x: Tensor) -> Tensor:
        """(B, 2*Cin, H, W) to (B, 2*Cout, H, W)."""
        y = self.conv(x)  # (B, 2*Cout, H, W)
        return functional.leaky_relu_(y.mul_(_both(self.gate(_means(y)))), 0.2)


class FoldedMSFusion(nn.Module):
    """MSFusion on [t0 | t1] channels; its three per-channel factors are applied in one pass.

    Gates are positive, so relu(g * u) = g * relu(u); the result is not negative, so the LeakyReLU after it
    would change nothing.
    """

    def __init__(self, block: MSFusion) -> None:
        super().__init__()
        conv = block.upconv.upconv[0]
        self.up = upsampling(conv, (conv.in_channels // 2,) * 2)
        self.first = folded_gate(block.upconv.upconv[1])
        self.weight = FoldedGate(block.conv[0])
        self.last = folded_gate(block.fg)

    def forward(self, x: Tensor) -> Tensor:
        """(B, 2*Cin, H, W), parts decoded and skip, to (B, 2*Cout, 2H, 2W)."""
        u = self.up(x)  # (B, 2*Cout, 2H, 2W)
        factor = self.first(_means(u)) * self.weight(_means(x, parts=2))  # (B, Cout, 1, 1)
        u = torch.relu_(u)
        factor = factor * self.last(factor * _means(u))  # (B, Cout, 1, 1)
        return u.mul_(_both(factor))


class FoldedGatedUpsampling(nn.Module):
    """GatedUpsampling, and the LeakyReLU that follows it, on [t0 | t1] channels."""

    def __init__(self, block: GatedUpsampling) -> None:
        super().__init__()
        conv = block.upconv[0]
        self.up = upsampling(conv, (conv.in_channels // 2,) * 2)
        self.gate = folded_gate(block.upconv[1])

    def forward(self, x: Tensor) -> Tensor:
        """(B, 2*Cin, H, W), parts decoded and skip, to (B, 2*Cout, 2H, 2W)."""
        u = self.up(x)  # (B, 2*Cout, 2H, 2W)
        return functional.leaky_relu_(u.mul_(_both(self.gate(_means(u)))), 0.2)


class FoldedClimNet(nn.Module):
    """ClimNet for inference, built from a reference ClimNet's weights at construction."""

    def __init__(self, reference: ClimNet) -> None:
        super().__init__()
        encoder, decoder = reference.encoder, reference.decoder
        self.stem_space = per_moment(encoder.stem[0])
        self.stem_time = across_moments(encoder.stem[3], (encoder.stem[3].in_channels,))
        self.stages = nn.ModuleList(
            FoldedGSTCBlock(stage[0]) for stage in (encoder.layer1, encoder.layer2, encoder.layer3, encoder.layer4)
        )
        fusions = [
            FoldedMSFusion(block) if isinstance(block, MSFusion) else FoldedGatedUpsampling(block)
            for block in decoder[1:4]
        ]
        self.decoders = nn.ModuleList([FoldedGatedConv(decoder[0], parts=1), *fusions])
        self.last = FoldedGatedConv(decoder[4], parts=2)
        self.fuse = _filled(_like(reference.feature_fuse.conv[0]), reference.feature_fuse.conv[0].weight, None)
        out = reference.outconv[1]
        self.out = _filled(_like(out), out.weight, out.bias)
        self.requires_grad_(False)
        self.eval()

    def forward(self, previous: Tensor, current: Tensor) -> Tensor:
        """As ClimNet.forward."""
        x = torch.cat([previous, current], 1)  # (B, 2*3, H, W)
        mean = _means(x)  # (B, 3, 1, 1)
        x = torch.relu_(self.stem_space(x - _both(mean)))  # (B, 2*stem, H, W)
        x = torch.relu_(self.stem_time(x))  # (B, 2*c1, H, W)
        skips = []
        for stage in self.stages:
            x = stage(x)  # (B, 2*c1 .. 2*c4, H .. H/8, W .. W/8)
            skips.append(x)
        for module, skip in zip(self.decoders, reversed(skips), strict=True):
            x = torch.cat([module(x), skip], 1)  # (B, 2*2*c4 .. 2*2*c1, H/8 .. H, W/8 .. W)
        x = self.last(x)  # (B, 2*c1, H, W)
        x = functional.leaky_relu_(self.fuse(x), 0.2)  # (B, c1, H, W)
        return self.out(functional.pad(x, (3, 3, 3, 3), "reflect")) + mean  # (B, 3, H, W)


def _like(conv: nn.Conv2d) -> nn.Conv2d:
    return nn.Conv2d(conv.in_channels, conv.out_channels, conv.kernel_size, bias=conv.bias is not None)

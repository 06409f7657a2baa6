"""ClimNet: draws the frame between two search patches (the paper's latent frame). Reference form, in 3-D.

Tensors are (B, C, T, H, W) with T = 2: the previous and the current patch. Names are the authors'.
`folded.py` computes the same with 2-D convolutions, faster.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from tracker.configs import ClimNetConfig

MOMENTS = 2  # T: the previous and the current patch
STRIDE = 8  # height and width must be divisible by it
COLOURS = 255.0


class Gate(nn.Module):
    """Feature gating: every channel is weighted by what the means of all channels say."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.attn_layer = nn.Sequential(nn.Conv3d(channels, channels, 1), nn.Sigmoid())

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, T, H, W) to the same shape."""
        return x * self.attn_layer(x.mean((2, 3, 4), keepdim=True))  # (B, C, T, H, W)


def _side_by_side(x: Tensor) -> Tensor:
    """(B, C, T, H, W) to (B, T*C, H, W)."""
    return x.transpose(1, 2).flatten(1, 2)


def _one_behind_the_other(x: Tensor) -> Tensor:
    """The way back: (B, T*C, H, W) to (B, C, T, H, W)."""
    return x.unflatten(1, (MOMENTS, -1)).transpose(1, 2)


class SpaceTimeConv(nn.Conv3d):
    """Convolution over three moments and k x k places, computed as a 2-D one over both moments side by side.

    PyTorch's own, learning in bf16 on a CPU, gives gradients that are noise, up to 1e40 (seen with 2.13).
    """

    def __init__(self, inputs: int, outputs: int, side: int, stride: int = 1, bias: bool = True) -> None:
        super().__init__(inputs, outputs, (3, side, side), (1, stride, stride), (1, side // 2, side // 2), bias=bias)

    def forward(self, x: Tensor) -> Tensor:
        """(B, Cin, T, H, W) to (B, Cout, T, H/stride, W/stride)."""
        w = self.weight  # (Cout, Cin, 3, k, k); output moment t reads input moment s through tap s - t + 1
        rows = [torch.cat([w[:, :, s - t + 1] for s in range(MOMENTS)], 1) for t in range(MOMENTS)]
        bias = None if self.bias is None else self.bias.repeat(MOMENTS)
        y = functional.conv2d(_side_by_side(x), torch.cat(rows), bias, self.stride[1:], self.padding[1:])
        return _one_behind_the_other(y)


class SpaceTimeUpsampling(nn.ConvTranspose3d):
    """Transposed convolution to twice the height and width over three moments, computed as SpaceTimeConv is."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__(inputs, outputs, (3, 4, 4), (1, 2, 2), (1, 1, 1))

    def forward(self, x: Tensor) -> Tensor:
        """(B, Cin, T, H, W) to (B, Cout, T, 2H, 2W)."""
        w = self.weight  # (Cin, Cout, 3, 4, 4); input moment s writes output moment t through tap t - s + 1
        rows = [torch.cat([w[:, :, t - s + 1] for t in range(MOMENTS)], 1) for s in range(MOMENTS)]
        bias = self.bias.repeat(MOMENTS)
        return _one_behind_the_other(functional.conv_transpose2d(_side_by_side(x), torch.cat(rows), bias, 2, 1))


class TemporalConv(nn.Conv3d):
    """Convolution over three moments at one place, computed as a 2-D one over moments and places.

    PyTorch's own, learning in bf16 on a CPU, ends in a segmentation fault at many sizes (seen with 2.13), and is
    three times slower.
    """

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__(inputs, outputs, (3, 1, 1), padding=(1, 0, 0), bias=False)

    def forward(self, x: Tensor) -> Tensor:
        """(B, Cin, T, H, W) to (B, Cout, T, H, W)."""
        y = functional.conv2d(x.flatten(3), self.weight[..., 0], padding=(1, 0))  # (B, Cout, T, H*W)
        return y.unflatten(3, x.shape[3:])


class GhostConv(nn.Module):
    """Ghost spatial convolution (half real, half cheap channels), then a temporal one."""

    def __init__(self, inputs: int, outputs: int, middle: int, stride: int) -> None:
        super().__init__()
        half = -(-middle // 2)
        self.middle = middle
        self.primary_conv = nn.Sequential(
            nn.Conv3d(inputs, half, (1, 3, 3), (1, stride, stride), (0, 1, 1), bias=False), nn.ReLU()
        )
        self.cheap_operation = nn.Sequential(
            nn.Conv3d(half, half, (1, 3, 3), padding=(0, 1, 1), groups=half, bias=False), nn.ReLU()
        )
        self.temporalconv = nn.Sequential(TemporalConv(middle, outputs))

    def forward(self, x: Tensor) -> Tensor:
        """(B, Cin, T, H, W) to (B, Cout, T, H/stride, W/stride)."""
        real = self.primary_conv(x)  # (B, half, T, H', W')
        cheap = self.cheap_operation(real)  # (B, half, T, H', W')
        return self.temporalconv(torch.cat([real, cheap], 1)[:, : self.middle])  # (B, Cout, T, H', W')


class GSTCBlock(nn.Module):
    """Ghost spatial-temporal residual block: two ghost convolutions, a shortcut, a gate; no ReLU after.

    ghost=False puts plain 3x3x3 convolutions in the ghost convolutions' place, for the ablation of GSTC; the
    width between a ghost convolution's two halves is chosen so that both kinds are of about equal size.
    """

    def __init__(self, inputs: int, outputs: int, stride: int, ghost: bool = True) -> None:
        super().__init__()
        middle = (inputs * outputs * 27) // (9 * inputs + 3 * outputs)

        def mixing(channels: int, step: int) -> nn.Module:
            if ghost:
                return GhostConv(channels, outputs, middle, step)
            return SpaceTimeConv(channels, outputs, 3, step, bias=False)

        self.conv1 = nn.Sequential(mixing(inputs, stride), nn.ReLU())
        self.conv2 = nn.Sequential(mixing(outputs, 1))
        self.fg = Gate(outputs)
        if stride != 1 or inputs != outputs:
            shortcut = nn.Conv3d(inputs, outputs, 1, (1, stride, stride), bias=False)
            self.downsample = nn.Sequential(shortcut)
        else:
            self.downsample = nn.Sequential()

    def forward(self, x: Tensor) -> Tensor:
        """(B, Cin, T, H, W) to (B, Cout, T, H/stride, W/stride)."""
        return self.fg(self.conv2(self.conv1(x)) + self.downsample(x))  # (B, Cout, T, H', W')


class Encoder(nn.Module):
    """Stem at full resolution, then four stages; only the last three halve it."""

    def __init__(self, config: ClimNetConfig, gstc: bool = True) -> None:
        super().__init__()
        c1, c2, c3, c4 = config.stages
        stem = config.stem
        self.stem = nn.Sequential(
            nn.Conv3d(3, stem, (1, 7, 7), padding=(0, 3, 3), bias=False),
            nn.Identity(),  # keeps the authors' numbering, whose batch normalisation is switched off
            nn.ReLU(),
            TemporalConv(stem, c1),
            nn.Identity(),
            nn.ReLU(),
        )
        self.layer1 = nn.Sequential(GSTCBlock(c1, c1, 1, gstc))
        self.layer2 = nn.Sequential(GSTCBlock(c1, c2, 2, gstc))
        self.layer3 = nn.Sequential(GSTCBlock(c2, c3, 2, gstc))
        self.layer4 = nn.Sequential(GSTCBlock(c3, c4, 2, gstc))

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """(B, 3, T, H, W) to four maps at 1, 1/2, 1/4 and 1/8 of the resolution."""
        x1 = self.layer1(self.stem(x))  # (B, c1, T, H, W)
        x2 = self.layer2(x1)  # (B, c2, T, H/2, W/2)
        x3 = self.layer3(x2)  # (B, c3, T, H/4, W/4)
        x4 = self.layer4(x3)  # (B, c4, T, H/8, W/8)
        return x1, x2, x3, x4


class GatedConv(nn.Module):
    """3x3x3 convolution and gate: the decoder's first and last modules."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.conv = nn.Sequential(SpaceTimeConv(inputs, outputs, 3), Gate(outputs))

    def forward(self, x: Tensor) -> Tensor:
        """(B, Cin, T, H, W) to (B, Cout, T, H, W)."""
        return self.conv(x)


class GatedUpsampling(nn.Module):
    """Transposed convolution to twice the height and width, and gate."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        up = SpaceTimeUpsampling(inputs, outputs)
        self.upconv = nn.Sequential(up, Gate(outputs))

    def forward(self, x: Tensor) -> Tensor:
        """(B, Cin, T, H, W) to (B, Cout, T, 2H, 2W)."""
        return self.upconv(x)


class MSFusion(nn.Module):
    """Multi-scale fusion: the upsampled map, weighted by the means of the coarse one, gated."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.upconv = GatedUpsampling(inputs, outputs)
        self.conv = nn.Sequential(nn.Conv3d(inputs, outputs, 1), nn.Sigmoid())
        self.fg = Gate(outputs)

    def forward(self, x: Tensor) -> Tensor:
        """(B, Cin, T, H, W) to (B, Cout, T, 2H, 2W), zero or more."""
        weight = self.conv(x.mean((2, 3, 4), keepdim=True))  # (B, Cout, 1, 1, 1)
        return self.fg(torch.relu(self.upconv(x)) * weight)  # (B, Cout, T, 2H, 2W)


class FeatureFuse(nn.Module):
    """1x1 convolution over the channels of both moments."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv = nn.Sequential(nn.Conv2d(2 * channels, channels, 1, bias=False))

    def forward(self, x: Tensor) -> Tensor:
        """(B, 2C, H, W) to (B, C, H, W)."""
        return self.conv(x)


class ClimNet(nn.Module):
    """The patch between two patches.

    gstc=False, ms_fusion=False: the paper's ablations, with plain 3x3x3 convolutions in the encoder's blocks and
    with plain gated upsampling in the decoder, as in FLAVR, from which ClimNet derives.
    """

    def __init__(self, config: ClimNetConfig, gstc: bool = True, ms_fusion: bool = True) -> None:
        super().__init__()
        c1, c2, c3, c4 = config.stages
        upsampling = MSFusion if ms_fusion else GatedUpsampling
        self.encoder = Encoder(config, gstc)
        self.decoder = nn.Sequential(
            GatedConv(c4, c4),
            upsampling(2 * c4, c3),
            upsampling(2 * c3, c2),
            upsampling(2 * c2, c1),
            GatedConv(2 * c1, c1),
        )
        self.feature_fuse = FeatureFuse(c1)
        self.outconv = nn.Sequential(nn.ReflectionPad2d(3), nn.Conv2d(c1, 3, 7))

    def forward(self, previous: Tensor, current: Tensor) -> Tensor:
        """Two patches (B, 3, H, W), 0..1, H and W divisible by 8, to the one between them, not clamped."""
        x = torch.stack([previous, current], 2)  # (B, 3, T, H, W)
        mean = x.mean((2, 3, 4), keepdim=True)  # (B, 3, 1, 1, 1)
        skips = self.encoder(x - mean)
        x = skips[-1]  # (B, c4, T, H/8, W/8)
        for module, skip in zip(self.decoder[:4], reversed(skips), strict=True):
            x = functional.leaky_relu(module(x), 0.2)
            x = torch.cat([x, skip], 1)  # (B, 2*c4 .. 2*c1, T, H/8 .. H, W/8 .. W)
        x = functional.leaky_relu(self.decoder[4](x), 0.2)  # (B, c1, T, H, W)
        x = x.transpose(1, 2).flatten(1, 2)  # (B, T*c1, H, W)
        x = functional.leaky_relu(self.feature_fuse(x), 0.2)  # (B, c1, H, W)
        return self.outconv(x) + mean.flatten(2, 3)  # (B, 3, H, W)


def latent_patch(climnet: nn.Module, previous: Tensor, current: Tensor) -> Tensor:
    """The patch between two search patches (B, 3, H, W) BGR 0..255, as whole numbers 0..255.

    Patches are zero-padded right and below to a multiple of 8, and the result is cut back and truncated
    to grey levels as in the authors' tracker, which stores it as an 8-bit image.
    """
    height, width = current.shape[2:]
    pad = (0, -width % STRIDE, 0, -height % STRIDE)
    pair = [functional.pad(patch, pad) / COLOURS for patch in (previous, current)]  # (B, 3, 288, 288)
    between = climnet(*pair)[:, :, :height, :width]  # (B, 3, H, W)
    return (between * COLOURS).clamp(0, COLOURS).floor()  # (B, 3, H, W)

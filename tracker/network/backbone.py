"""Backbone: AlexNet with batch normalisation and no padding, total stride 8 (the paper's phi)."""

from __future__ import annotations

from torch import Tensor, nn

from tracker.configs import NetworkConfig

Features = tuple[Tensor, ...]  # of the last layers, layer 5 last


class Backbone(nn.Module):
    """Features of one image patch.

    Input (B, 3, H, W) BGR 0..255; a 127 px template gives (B, c4, 8, 8) and (B, c5, 6, 6),
    a 287 px search patch (B, c4, 28, 28) and (B, c5, 26, 26). Where HiFT's transformer follows, layer 3 comes
    before them: (B, c3, 10, 10) or (B, c3, 30, 30). Submodules carry the authors' names.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        c1, c2, c3, c4, c5 = config.backbone_channels
        self.mean = config.input_mean
        self.scale = config.input_scale
        self.gives_layer3 = config.variant.is_hift
        # The authors pool before the activation; for max pooling and ReLU the order makes no difference.
        self.layer1 = nn.Sequential(
            nn.Conv2d(3, c1, 11, stride=2), nn.BatchNorm2d(c1), nn.MaxPool2d(3, 2), nn.ReLU(inplace=True)
        )
        self.layer2 = nn.Sequential(nn.Conv2d(c1, c2, 5), nn.BatchNorm2d(c2), nn.MaxPool2d(3, 2), nn.ReLU(inplace=True))
        self.layer3 = nn.Sequential(nn.Conv2d(c2, c3, 3), nn.BatchNorm2d(c3), nn.ReLU(inplace=True))
        self.layer4 = nn.Sequential(nn.Conv2d(c3, c4, 3), nn.BatchNorm2d(c4), nn.ReLU(inplace=True))
        self.layer5 = nn.Sequential(nn.Conv2d(c4, c5, 3), nn.BatchNorm2d(c5))

    def forward(self, x: Tensor) -> Features:
        """(layer 4, layer 5), for HiFT (layer 3, layer 4, layer 5).

        Layer 5 ends without activation, for it is correlated as it is.
        """
        if self.mean != 0.0 or self.scale != 1.0:
            x = (x - self.mean) * self.scale  # (B, 3, 287, 287)
        x = self.layer1(x)  # (B, c1, 69, 69)
        x = self.layer2(x)  # (B, c2, 32, 32)
        x3 = self.layer3(x)  # (B, c3, 30, 30)
        x4 = self.layer4(x3)  # (B, c4, 28, 28)
        x5 = self.layer5(x4)  # (B, c5, 26, 26)
        return (x3, x4, x5) if self.gives_layer3 else (x4, x5)

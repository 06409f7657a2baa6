"""The whole ClimRT network, under the authors' names: `backbone.`, `internet.` (ClimNet), `grader.`."""

from __future__ import annotations

from torch import Tensor, nn

from tracker.configs import NetworkConfig
from tracker.network.backbone import Backbone, Features
from tracker.network.climnet import ClimNet
from tracker.network.heads import Grader, Predictions

__all__ = ["ClimRT", "Features"]


class ClimRT(nn.Module):
    """Backbone, ClimNet (where the configuration has one) and grader, as separate steps; all take batches.

    The configuration's variant makes it one of the paper's ablations; the steps stay the same.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        self.backbone = Backbone(config)
        variant = config.variant
        self.internet = (
            ClimNet(config.climnet, gstc=variant.has_gstc, ms_fusion=variant.has_ms_fusion)
            if config.climnet is not None
            else None
        )
        self.grader = Grader(config)

    def template(self, z: Tensor) -> Features:
        """Template (B, 3, 127, 127) BGR 0..255 to layer 4 (B, c4, 8, 8) and layer 5 (B, c5, 6, 6), last."""
        return self.backbone(z)

    def features(self, x: Tensor) -> Features:
        """Search patch (B, 3, 287, 287) BGR 0..255 to layer 4 (B, c4, 28, 28), layer 5 (B, c5, 26, 26), last."""
        return self.backbone(x)

    def heads(self, xf: Features, zf: Features, latent_l5: Tensor) -> Predictions:
        """Predictions from search, template and latent (layer 5 only) features; see Grader for who uses which."""
        return self.grader(xf, zf, latent_l5)

    def forward(self, z: Tensor, x: Tensor, latent: Tensor) -> Predictions:
        """Template, search patch and the patch that stands for the latent frame, to Predictions."""
        return self.heads(self.features(x), self.template(z), self.features(latent)[-1])

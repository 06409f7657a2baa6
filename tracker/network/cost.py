"""What a network costs: parameters and multiply-adds per frame, counted by running it without data."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

from tracker.configs import NetworkConfig, TrackerConfig
from tracker.network.climnet import latent_patch
from tracker.network.climrt import ClimRT
from tracker.network.folded import FoldedClimNet


@dataclass(frozen=True, slots=True)
class Cost:
    """Parameters, and multiply-adds in units of 1e9 (GMAC).

    frame_gmac: one update without ClimNet. climnet_gmac: what a drawn latent frame adds (ClimNet in its 2-D
    form and its own pass through the backbone), 0 for a network without. template_gmac: once, at init.
    """

    backbone_params: int
    heads_params: int
    climnet_params: int
    template_gmac: float
    backbone_gmac: float
    heads_gmac: float
    climnet_gmac: float

    @property
    def frame_gmac(self) -> float:
        """One update without ClimNet."""
        return self.backbone_gmac + self.heads_gmac


def cost(config: NetworkConfig, tracker: TrackerConfig | None = None) -> Cost:
    """Count a configuration's parameters and work per frame."""
    tracker = tracker or TrackerConfig()
    with torch.device("meta"), torch.no_grad():
        network = ClimRT(config).train()  # eval mode's fused attention would escape the counter
        z = torch.zeros(1, 3, tracker.exemplar_px, tracker.exemplar_px)
        x = torch.zeros(1, 3, tracker.search_px, tracker.search_px)
        zf, xf = network.template(z), network.features(x)
        backbone_gmac = _gmac(lambda: network.features(x))
        climnet_gmac = 0.0
        if network.internet is not None:
            folded = FoldedClimNet(network.internet)
            climnet_gmac = backbone_gmac + _gmac(lambda: latent_patch(folded, x, x))
        return Cost(
            _params(network.backbone),
            _params(network.grader),
            _params(network.internet),
            _gmac(lambda: network.template(z)),
            backbone_gmac,
            _gmac(lambda: network.heads(xf, zf, xf[-1])),
            climnet_gmac,
        )


def _params(module: nn.Module | None) -> int:
    return 0 if module is None else sum(p.numel() for p in module.parameters())


def _gmac(run) -> float:
    with FlopCounterMode(display=False) as counter:
        run()
    return counter.get_total_flops() / 2e9

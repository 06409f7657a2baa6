"""The reference engine: PyTorch, one operation after the other, on any of its devices."""

from __future__ import annotations

import torch
from torch import Tensor

from tracker.crop import Colour, Image, crop
from tracker.engines.engine import Engine, Patch
from tracker.network.climnet import latent_patch
from tracker.network.climrt import ClimRT, Features
from tracker.network.heads import Predictions
from tracker.network.inference import for_inference


class EagerEngine:
    """See Engine."""

    name = "torch"

    def __init__(self, network: ClimRT) -> None:
        """network: as trained; it is copied and made ready here. It runs where its parameters are."""
        self._network = for_inference(network)
        self._device = next(network.parameters()).device
        self.has_climnet = network.internet is not None

    def cut(self, frame_bgr: Image, cx_px: float, cy_px: float, side_px: int, out_px: int, fill: Colour) -> Patch:
        """See Engine."""
        patch = crop(frame_bgr, cx_px, cy_px, side_px, out_px, fill)
        return torch.from_numpy(patch)[None].to(self._device)

    @torch.inference_mode()
    def embed(self, patch: Patch) -> Features:
        """See Engine."""
        return self._network.features(_as_input(patch))

    @torch.inference_mode()
    def compare(self, search: Features, template: Features, latent5: Tensor) -> Predictions:
        """See Engine."""
        return self._network.heads(search, template, latent5)

    @torch.inference_mode()
    def imagine(self, earlier: Patch, current: Patch) -> Tensor:
        """See Engine."""
        assert self._network.internet is not None, "has_climnet says whether this may be asked"
        between = latent_patch(self._network.internet, _as_input(earlier), _as_input(current))
        return self._network.features(between)[-1]


def _as_input(patch: Patch) -> Tensor:
    """(1, S, S, 3) uint8 to (1, 3, S, S) float 0..255; stays channels-last in memory, as the network's."""
    return patch.permute(0, 3, 1, 2).float()


def as_engine(network: ClimRT | Engine) -> Engine:
    """The engine itself, or the reference engine for a network."""
    return EagerEngine(network) if isinstance(network, ClimRT) else network

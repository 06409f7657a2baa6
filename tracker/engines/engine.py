"""What the online tracker asks of whatever runs its network: cut a patch, embed it, compare, imagine."""

from __future__ import annotations

from typing import Protocol

from torch import Tensor

from tracker.crop import Colour, Image
from tracker.network.climrt import Features
from tracker.network.heads import Predictions


class EngineError(ValueError):
    """No such engine, one that cannot run here or with this network, or its files; one line: what and where."""


Patch = Tensor  # (1, S, S, 3) uint8 BGR, on the engine's device


class Engine(Protocol):
    """One network, ready to run. Not for several threads at once.

    Tensors are float32 on the engine's device and belong to the caller: no later call changes them.
    """

    @property
    def name(self) -> str:
        """As it is chosen by, and recorded."""
        ...

    @property
    def has_climnet(self) -> bool:
        """Whether it can imagine a latent frame."""
        ...

    def cut(self, frame_bgr: Image, cx_px: float, cy_px: float, side_px: int, out_px: int, fill: Colour) -> Patch:
        """As `tracker.crop.crop`."""
        ...

    def embed(self, patch: Patch) -> Features:
        """Features of a template patch (127 px) or a search patch (287 px), layer 4 before layer 5."""
        ...

    def compare(self, search: Features, template: Features, latent5: Tensor) -> Predictions:
        """What the heads say of each cell."""
        ...

    def imagine(self, earlier: Patch, current: Patch) -> Tensor:
        """Layer-5 features of the frame that ClimNet draws between two search patches."""
        ...

"""Where the latent frame's layer-5 features come from: one small strategy per LatentProvider."""

from __future__ import annotations

from collections import deque
from typing import Protocol, assert_never

from torch import Tensor

from tracker.configs import ConfigError, LatentProvider, TrackerConfig
from tracker.engines.engine import Engine, Patch


class LatentSource(Protocol):
    """Features of the moment between an earlier search patch and the current one."""

    def reset(self) -> None:
        """Forget earlier patches: the next patch is the first."""

    def latent5(self, patch: Patch, features5: Tensor) -> Tensor:
        """Layer-5 features (1, c5, 26, 26), from the current patch and its own features."""


class ClimNetLatent:
    """ClimNet between the patch `interval` frames back (the paper's m) and the current one."""

    def __init__(self, engine: Engine, interval: int) -> None:
        if not engine.has_climnet:
            raise ConfigError("latent = climnet: these weights hold no ClimNet; use previous or off")
        self._engine = engine
        self._patches: deque[Patch] = deque(maxlen=interval)

    def reset(self) -> None:
        """See LatentSource."""
        self._patches.clear()

    def latent5(self, patch: Patch, features5: Tensor) -> Tensor:
        """See LatentSource; at the start, the oldest patch there is, and the first time the patch itself."""
        earlier = self._patches[0] if self._patches else patch
        self._patches.append(patch)
        return self._engine.imagine(earlier, patch)


class PreviousLatent:
    """The features that the patch `interval` frames back had: already there, so this costs nothing."""

    def __init__(self, interval: int) -> None:
        self._features: deque[Tensor] = deque(maxlen=interval)

    def reset(self) -> None:
        """See LatentSource."""
        self._features.clear()

    def latent5(self, patch: Patch, features5: Tensor) -> Tensor:
        """See LatentSource; the first time the current patch's own features."""
        earlier = self._features[0] if self._features else features5
        self._features.append(features5)
        return earlier


class OwnLatent:
    """The current patch's own features: the network without any temporal information."""

    def reset(self) -> None:
        """See LatentSource."""

    def latent5(self, patch: Patch, features5: Tensor) -> Tensor:
        """See LatentSource."""
        return features5


def latent_source(engine: Engine, config: TrackerConfig) -> LatentSource:
    """The strategy a configuration asks for. Raises ConfigError where there is no ClimNet."""
    match config.latent:
        case LatentProvider.CLIMNET:
            return ClimNetLatent(engine, config.latent_interval)
        case LatentProvider.PREVIOUS:
            return PreviousLatent(config.latent_interval)
        case LatentProvider.OFF:
            return OwnLatent()
        case _:
            assert_never(config.latent)

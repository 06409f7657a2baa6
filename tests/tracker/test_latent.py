from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from tests.tracker.conftest import TINY, random_network
from tracker.configs import ConfigError, LatentProvider, TrackerConfig
from tracker.engines import eager
from tracker.engines.eager import EagerEngine
from tracker.latent import latent_source
from tracker.network.climrt import ClimRT


def marked(n: int) -> Tensor:
    return torch.full((1,), float(n))


@pytest.mark.parametrize(
    ("interval", "wanted"),
    [(1, [0, 0, 1, 2, 3, 4]), (2, [0, 0, 0, 1, 2, 3]), (3, [0, 0, 0, 0, 1, 2]), (5, [0, 0, 0, 0, 0, 0])],
)
def test_previous_looks_m_frames_back(tiny: ClimRT, interval: int, wanted: list[int]) -> None:
    source = latent_source(EagerEngine(tiny), TrackerConfig(latent=LatentProvider.PREVIOUS, latent_interval=interval))
    assert [int(source.latent5(marked(-1), marked(t))) for t in range(6)] == wanted
    source.reset()
    assert int(source.latent5(marked(-1), marked(9))) == 9


@pytest.mark.parametrize(("interval", "wanted"), [(1, [0, 0, 1, 2]), (2, [0, 0, 0, 1])])
def test_climnet_gets_the_patch_m_frames_back(
    tiny: ClimRT, monkeypatch: pytest.MonkeyPatch, interval: int, wanted: list[int]
) -> None:
    pairs: list[tuple[int, int]] = []

    def fake(climnet: object, earlier: Tensor, current: Tensor) -> Tensor:
        assert climnet is not None
        pairs.append((int(earlier[0, 0, 0, 0]), int(current[0, 0, 0, 0])))
        return current

    monkeypatch.setattr(eager, "latent_patch", fake)
    source = latent_source(EagerEngine(tiny), TrackerConfig(latent=LatentProvider.CLIMNET, latent_interval=interval))
    for t in range(4):
        image = torch.full((1, 287, 287, 3), t, dtype=torch.uint8)
        assert source.latent5(image, marked(-1)).shape == (1, 8, 26, 26)
    assert pairs == list(zip(wanted, range(4), strict=True))


def test_off_is_the_patch_itself(tiny: ClimRT) -> None:
    source = latent_source(EagerEngine(tiny), TrackerConfig(latent=LatentProvider.OFF))
    assert [int(source.latent5(marked(-1), marked(t))) for t in range(3)] == [0, 1, 2]


def test_climnet_must_be_there() -> None:
    network = random_network(replace(TINY, climnet=None))
    with pytest.raises(ConfigError, match="hold no ClimNet"):
        latent_source(EagerEngine(network), TrackerConfig(latent=LatentProvider.CLIMNET))

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from tests.tracker.conftest import TINY, assert_learns, random_network
from tracker.configs import COMPACT, FULL, ConfigError, LatentProvider, NetworkConfig, TrackerConfig
from tracker.network.climnet import latent_patch
from tracker.network.climrt import ClimRT
from tracker.network.correlation import correlate
from tracker.network.cost import cost
from tracker.network.folded import FoldedClimNet
from tracker.network.inference import for_inference


def patches(count: int, side: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(count, 3, side, side, generator=generator) * 255


def test_shapes_and_gradients_in_training() -> None:
    torch.manual_seed(0)
    network = ClimRT(replace(TINY, climnet=None)).train()
    assert_learns(network, network(patches(2, 127), patches(2, 287, 1), patches(2, 287, 2)))


@pytest.mark.parametrize("legacy", [False, True])
def test_a_batch_equals_its_samples(legacy: bool) -> None:
    network = random_network(replace(TINY, legacy_layout=legacy))
    z, x, latent = patches(3, 127), patches(3, 287, 1), patches(3, 287, 2)
    together = network(z, x, latent)
    for i in range(3):
        alone = network(z[i : i + 1], x[i : i + 1], latent[i : i + 1])
        for whole, single in zip(together, alone, strict=True):
            torch.testing.assert_close(whole[i : i + 1], single, rtol=0, atol=1e-4)


def test_correlation_is_the_sum_over_the_template() -> None:
    x, z = torch.randn(2, 3, 9, 9), torch.randn(2, 3, 4, 4)
    out = correlate(x, z)
    assert out.shape == (2, 3, 6, 6)
    torch.testing.assert_close(out[1, 2, 3, 4], (x[1, 2, 3:7, 4:8] * z[1, 2]).sum())


def test_inference_form_gives_the_same(tiny: ClimRT) -> None:
    ready = for_inference(tiny)
    assert not any(isinstance(m, torch.nn.BatchNorm2d) for m in ready.modules())
    z, x, latent = patches(1, 127), patches(1, 287, 1), patches(1, 287, 2)
    for ours, reference in zip(ready(z, x, latent), tiny(z, x, latent), strict=True):
        torch.testing.assert_close(ours, reference, rtol=0, atol=1e-4)
    assert tiny.backbone.mean == TINY.input_mean  # the original is untouched


@pytest.mark.parametrize("config", [TINY, COMPACT], ids=["tiny", "compact"])
@pytest.mark.parametrize("batch", [1, 2])
def test_folded_climnet_equals_the_reference(config: NetworkConfig, batch: int) -> None:
    climnet = random_network(config).internet
    folded = FoldedClimNet(climnet)
    assert not any(isinstance(m, (torch.nn.Conv3d, torch.nn.ConvTranspose3d)) for m in folded.modules())
    first, second = patches(batch, 40) / 255, patches(batch, 40, 1) / 255
    wanted = climnet(first, second)
    assert wanted.std() > 1e-3  # far above the tolerance: it does depend on the input
    torch.testing.assert_close(folded(first, second), wanted, rtol=0, atol=2e-5)


def test_latent_patch_keeps_the_size_and_whole_levels(tiny: ClimRT) -> None:
    latent = latent_patch(tiny.internet, patches(1, 43), patches(1, 43, 1))
    assert latent.shape == (1, 3, 43, 43)
    torch.testing.assert_close(latent, latent.floor(), rtol=0, atol=0)
    assert 0 <= latent.min() <= latent.max() <= 255


def test_cost_is_the_published_one() -> None:
    full = cost(FULL)
    assert full.backbone_params == 3_749_952
    assert full.backbone_gmac == pytest.approx(5.704, abs=0.001)
    assert full.template_gmac == pytest.approx(0.711, abs=0.001)
    assert full.heads_gmac == pytest.approx(0.72, abs=0.01)
    assert full.climnet_gmac - full.backbone_gmac == pytest.approx(166, abs=0.5)
    assert cost(replace(TINY, climnet=None)).climnet_gmac == 0


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"heads": 7}, "heads = 7"),
        ({"group_norm_groups": 5}, "group_norm_groups = 5"),
        ({"hidden": 95}, "hidden = 95"),
        ({"backbone_channels": (1, 2, 3)}, "backbone_channels"),
        ({"dropout": 1.0}, "dropout"),
        ({"input_scale": 0.0}, "input_scale"),
    ],
)
def test_unusable_network_configurations(change: dict[str, object], field: str) -> None:
    with pytest.raises(ConfigError, match=field):
        replace(COMPACT, **change)


@pytest.mark.parametrize("config", [FULL, COMPACT, replace(COMPACT, climnet=None)])
def test_network_configuration_round_trip(config: NetworkConfig) -> None:
    assert NetworkConfig.from_dict(config.to_dict()) == config


@pytest.mark.parametrize("change", [{"hidden": None}, {"colour": 3}, {"climnet": 5}, {"climnet": {"stem": 3}}])
def test_malformed_network_configuration(change: dict[str, object]) -> None:
    with pytest.raises(ConfigError):
        NetworkConfig.from_dict(COMPACT.to_dict() | change)


def test_tracker_configuration() -> None:
    config = TrackerConfig(latent=LatentProvider.OFF, latent_interval=3)
    assert TrackerConfig.from_dict(config.to_dict()) == config
    for values in ({"latent": "none"}, {"latent_interval": 6}, {"size_rate": -1}, {"speed": 1}):
        with pytest.raises(ConfigError):
            TrackerConfig.from_dict(values)

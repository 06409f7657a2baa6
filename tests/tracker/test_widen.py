"""A narrow network and its wide copy say the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from tests.tracker.conftest import TINY, random_network
from tests.tracker.test_network import patches
from tracker.configs import COMPACT, FULL, NETWORKS, WIDE, NetworkConfig
from tracker.network.climrt import ClimRT
from tracker.train.checkpoint import start_from
from tracker.train.config import Stage, StageKind, TrainConfig
from tracker.train.devices import Team
from tracker.train.loop import Run
from tracker.train.widen import WidenError, can_widen, spread, widen, widened
from tracker.weights import DATA, save

NARROW = replace(TINY, cross_attention_residual=True)
# Uneven copies in the backbone, two per channel elsewhere, groups as many again, so halves of the copied ones.
BROAD = replace(NARROW, name="broad", backbone_channels=(6, 12, 16, 20, 19), hidden=32, ffn=96, group_norm_groups=8)


def outputs(network: ClimRT) -> list[torch.Tensor]:
    torch.manual_seed(3)
    pixels = [torch.rand(1, 3, side, side) * 255 for side in (127, 287, 287)]
    with torch.inference_mode():
        return list(network(*pixels))


@pytest.mark.parametrize("config", [BROAD, replace(BROAD, group_norm_groups=4)], ids=["more groups", "same groups"])
def test_a_widened_network_gives_the_same(config: NetworkConfig) -> None:
    network = random_network(NARROW)
    wide = widen(network, config)
    for ours, reference in zip(outputs(wide), outputs(network), strict=True):
        assert reference.std() > 1e-3
        torch.testing.assert_close(ours, reference, rtol=0, atol=1e-4)
    for ours, reference in zip(wide.internet.parameters(), network.internet.parameters(), strict=True):
        assert torch.equal(ours, reference)


def test_compact_weights_widen_to_the_papers_widths() -> None:
    compact = widened(DATA / "compact.safetensors", COMPACT)  # through the same code, for its errors
    wide = widened(DATA / "compact.safetensors", WIDE)
    assert wide.grader.conv1[0].weight.shape == (FULL.hidden, FULL.backbone_channels[3], 3, 3)
    for ours, reference in zip(outputs(wide), outputs(compact), strict=True):
        torch.testing.assert_close(ours, reference, rtol=0, atol=1e-4)


def test_copies_learn_different_things() -> None:
    """Copies with the same gradient would stay copies for ever."""
    wide = widen(random_network(NARROW), BROAD).train().requires_grad_(True)
    loc = wide(patches(2, 127), patches(2, 287, 1), patches(2, 287, 2)).loc
    loc.square().sum().backward()
    gradient = wide.backbone.layer3[0].weight.grad
    copies = spread(NARROW.backbone_channels[2], BROAD.backbone_channels[2])
    twins = [(i, i + 1) for i in range(len(copies) - 1) if copies[i] == copies[i + 1]]
    for a, b in twins:
        assert not torch.allclose(gradient[a], gradient[b], rtol=1e-2)
        assert gradient[a].abs().max() > 0


def test_noise_changes_the_function_a_little() -> None:
    network = random_network(NARROW)
    exact, noisy = outputs(widen(network, BROAD)), outputs(widen(network, BROAD, noise_frac=0.01))
    assert 1e-4 < (exact[0] - noisy[0]).abs().max() < 0.5


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"hidden": 24, "group_norm_groups": 8}, "hidden"),
        ({"heads": 4}, "heads"),
        ({"legacy_layout": True}, "legacy_layout"),
        ({"cross_attention_residual": False}, "cross_attention_residual"),
        ({"group_norm_groups": 16}, "group_norm_groups"),
        ({"ffn": 16}, "ffn"),
        ({"backbone_channels": (4, 4, 8, 8, 7)}, "backbone_channels"),
        ({"input_mean": 0.0}, "input_mean"),
    ],
)
def test_what_cannot_be_exact_is_refused(change: dict[str, object], field: str) -> None:
    with pytest.raises(WidenError, match=field):
        widen(random_network(NARROW), replace(BROAD, **change))


def test_the_papers_own_layout_is_refused(tmp_path: Path) -> None:
    path = save(tmp_path / "narrow.safetensors", random_network(replace(NARROW, climnet=None)))
    with pytest.raises(WidenError, match="heads"):
        widened(path, FULL)


def test_a_wide_run_starts_from_narrow_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(NETWORKS, "broad", BROAD)
    narrow = random_network(replace(NARROW, climnet=None))
    path = save(tmp_path / "narrow.safetensors", narrow)
    stages = (Stage(StageKind.JOINT, steps=1),)
    run = Run(TrainConfig(network="broad", stages=stages), tmp_path / "run", Team(torch.device("cpu")), str)
    said = start_from(run, str(path))
    assert "the backbone taken, ClimNet is not in it: begins anew, the grader taken" in said
    for network in (run.network.eval(), run.average):
        for ours, reference in zip(outputs(network), outputs(narrow), strict=True):
            torch.testing.assert_close(ours, reference, rtol=0, atol=1e-4)


def test_only_wider_networks_of_the_same_kind_are_widened_to() -> None:
    assert can_widen(COMPACT, WIDE)
    assert not can_widen(COMPACT, COMPACT)
    assert not can_widen(COMPACT, FULL)
    assert not can_widen(WIDE, COMPACT)

"""Where training starts."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from tracker.configs import COMPACT
from tracker.network.climnet import ClimNet
from tracker.train.losses import edge_loss
from tracker.train.priming import initial_network, prime_climnet


@pytest.mark.parametrize("gstc", [True, False])
def test_climnet_begins_with_the_mean_of_both_frames(gstc: bool) -> None:
    torch.manual_seed(0)
    assert COMPACT.climnet is not None
    network = ClimNet(COMPACT.climnet, gstc=gstc)
    previous, current = torch.rand(2, 1, 3, 32, 32)
    mean = (previous + current) / 2
    before = (network(previous, current) - mean).abs().mean()
    prime_climnet(network)
    error = (network(previous, current) - mean)[..., 4:-4, 4:-4].abs().mean()
    assert error < 0.03
    assert error < before / 5


def test_a_primed_climnet_learns_all_its_weights() -> None:
    network = initial_network(replace(COMPACT, name="tiny"), 1).internet
    assert network is not None
    network(*torch.rand(2, 1, 3, 32, 32)).square().mean().backward()
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.abs().sum() > 0, name


def test_edges_cost_by_how_far_off_they_are() -> None:
    target = torch.zeros(1, 4, 11, 11)
    weight = torch.ones(1, 1, 11, 11)
    target += torch.tanh(torch.tensor(32 / 143))
    assert edge_loss(target, target, weight) == 0
    shifted = target.clone()
    shifted[:, 0] = torch.tanh(torch.tensor((32 - 6.4) / 143))  # left side 6.4 px further in
    expected = 6.4 / 64 / 4 + 0.5 * abs(torch.log(torch.tensor(57.6 / 64))) / 2
    assert edge_loss(shifted, target, weight).item() == pytest.approx(expected.item(), rel=1e-3)
    assert edge_loss(shifted, target, 0 * weight) == 0

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from tracker.configs import COMPACT, ClimNetConfig, NetworkConfig
from tracker.network.climrt import ClimRT

# Every part, as narrow as it goes: tests of plumbing need no capacity.
TINY = NetworkConfig(
    name="tiny",
    backbone_channels=(4, 4, 8, 8, 8),
    hidden=16,
    heads=2,
    ffn=32,
    group_norm_groups=4,
    climnet=ClimNetConfig(stem=3, stages=(4, 6, 8, 10)),
    legacy_layout=False,
    input_mean=COMPACT.input_mean,
    input_scale=COMPACT.input_scale,
)


def random_network(config: NetworkConfig = TINY, seed: int = 0) -> ClimRT:
    """A network with random weights and random batch statistics."""
    torch.manual_seed(seed)
    network = ClimRT(config).eval()
    for name, buffer in network.named_buffers():
        if name.endswith("running_mean"):
            buffer.uniform_(-0.5, 0.5)
        elif name.endswith("running_var"):
            buffer.uniform_(0.5, 2)
    return network.requires_grad_(False)


def assert_learns(network: ClimRT, out: tuple[torch.Tensor, ...]) -> None:
    """The predictions of two samples have their shapes, and every weight a finite gradient."""
    assert [tuple(m.shape) for m in out] == [(2, 4, 11, 11), (2, 2, 11, 11), (2, 1, 11, 11)]
    torch.stack([m.square().sum() for m in out]).sum().backward()
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None, name
        assert torch.isfinite(parameter.grad).all(), name


@pytest.fixture(scope="session")
def tiny() -> ClimRT:
    return random_network()


@pytest.fixture(autouse=True)
def denormal_numbers() -> Iterator[None]:
    """Training flushes them in the whole process: the tests after it shall have them again."""
    yield
    torch.set_flush_denormal(False)

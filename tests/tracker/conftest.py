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


@pytest.fixture(scope="session")
def tiny() -> ClimRT:
    return random_network()


@pytest.fixture(autouse=True)
def denormal_numbers() -> Iterator[None]:
    """Training flushes them in the whole process: the tests after it shall have them again."""
    yield
    torch.set_flush_denormal(False)

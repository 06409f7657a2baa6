"""The full network with the reference weights, and the reference data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from tests.parity.golden import rule
from tracker.configs import FULL
from tracker.network.climrt import ClimRT

GOLDEN = Path(__file__).parent / "golden"
Golden = Callable[[str], Mapping[str, NDArray[np.generic]]]


def official_keys() -> dict[str, tuple[tuple[int, ...], str]]:
    """Shape and dtype of every tensor in the authors' whole checkpoint."""
    rows = (line.split("\t") for line in (GOLDEN / "keys.txt").read_text().splitlines())
    return {key: (tuple(int(n) for n in shape.strip("(),").split(",") if n), dtype) for key, shape, dtype in rows}


def official_state_dict() -> dict[str, torch.Tensor]:
    """The whole checkpoint, filled by the rule."""
    return {
        key: torch.from_numpy(np.array(rule.fill(key, shape, dtype))) for key, (shape, dtype) in official_keys().items()
    }


def patch(seed: int, side: int) -> torch.Tensor:
    """(1, 3, side, side) float 0..255."""
    return torch.from_numpy(rule.patch(seed, side, side))


@pytest.fixture(scope="session")
def golden() -> Golden:
    def load(name: str) -> Mapping[str, NDArray[np.generic]]:
        with np.load(GOLDEN / f"{name}.npz") as file:
            return dict(file)

    return load


@pytest.fixture(scope="session")
def state_dict() -> dict[str, torch.Tensor]:
    return official_state_dict()


@pytest.fixture(scope="session")
def full(state_dict: dict[str, torch.Tensor]) -> ClimRT:
    network = ClimRT(FULL).eval().requires_grad_(False)
    report = network.load_state_dict(state_dict, strict=False)
    assert not report.missing_keys
    assert all(".eles." in key or ".bn3d." in key for key in report.unexpected_keys)
    return network


@pytest.fixture(scope="session")
def features(full: ClimRT) -> dict[str, tuple[torch.Tensor, torch.Tensor]]:
    """Backbone outputs of template z, search patch x and the patch f that stands for the latent frame."""
    patches = {"z": patch(100, 127), "x": patch(200, 287), "f": patch(300, 287)}
    return {name: full.features(image) for name, image in patches.items()}

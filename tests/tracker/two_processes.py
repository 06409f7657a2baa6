"""Two training steps on drawn batches, by one process or by torchrun's; writes the weights that come of it.

Batch statistics keep still (PyTorch joins them over processes on GPUs only), other templates' silence is not asked
for (each process has its own others), and both halves of a batch have the same boxes, so that losses divided by
a number of positive cells are divided alike: what is left is the averaging of gradients, and must be exact.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import nn

from tests.tracker.conftest import TINY
from tracker.configs import NETWORKS
from tracker.train.config import TrainConfig
from tracker.train.dataset import Batch
from tracker.train.devices import Team, assemble
from tracker.train.labels import make_labels
from tracker.train.loop import Run

HALF, STEPS = 2, 2


def config(kind: str) -> TrainConfig:
    stage = {"kind": kind, "steps": 100, "batch": HALF, "learning_rate": 0.05, "optimizer": "sgd", "patch_px": 64}
    values = {"network": "tiny", "threads": 1, "precision": "fp32", "warmup_steps": 1, "cross_negative_weight": 0.0}
    return TrainConfig.from_dict({**values, "seed": 4, "stages": [stage]})


def drawn_batch(step: int) -> Batch:
    """Two halves with the same boxes and other pictures."""
    rng = np.random.default_rng(step)
    shapes = {"template": 127, "previous": 287, "search": 287, "middle": 287}
    batch = {k: torch.from_numpy(rng.integers(0, 256, (2 * HALF, s, s, 3), np.uint8)) for k, s in shapes.items()}
    corner = rng.uniform(70, 130, (HALF, 2))
    box = np.tile(np.hstack([corner, corner + rng.uniform(50, 80, (HALF, 2))]), (2, 1)).astype(np.float32)
    half = [make_labels(tuple(b), rng) for b in box[:HALF]]
    for name in half[0]._fields:
        batch[f"label_{name}"] = torch.from_numpy(np.stack([getattr(x, name) for x in half * 2]))
    return batch | {"box": torch.from_numpy(box), "positive": torch.ones(2 * HALF, dtype=torch.bool)}


def learn(kind: str, folder: Path, team: Team, share: slice) -> dict[str, torch.Tensor]:
    """Weights after the steps, of a process that takes `share` of every batch."""
    NETWORKS["tiny"] = replace(TINY, dropout=0.0)
    run = Run(config(kind), folder, team, print)
    for module in run.network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.eval()
    for step in range(STEPS):
        run.step({k: v[share] for k, v in drawn_batch(step).items()})
        run.position.count(2 * HALF, 1.0)
    return run.network.state_dict()


def main() -> None:
    folder = Path(sys.argv[1])
    team = assemble(device="cpu")
    share = slice(team.rank * HALF, (team.rank + 1) * HALF)
    for kind in ("climnet", "joint"):
        weights = learn(kind, folder / str(team.rank), team, share)
        torch.save(weights, folder / f"{kind}{team.rank}.pt")
    now, stop = team.agree(5.0 + team.rank, team.rank == 1)
    assert (now, stop) == (5.0, True)
    assert team.share(team.rank) == 0
    assert (folder / str(team.rank) / "config.json").exists() == team.leads
    team.disband()


if __name__ == "__main__":
    main()

"""The probe measures each part, and says what to change."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from tests.tracker.conftest import TINY
from tests.tracker.packs import write_pack
from tracker.configs import NETWORKS
from tracker.train.cli import Options, train
from tracker.train.config import Stage, StageKind, TrainConfig
from tracker.train.probe import Costs, verdict

EASY = Costs(
    made_per_s=200.0,
    transfer_s=0.0,
    forward_s=0.004,
    backward_s=0.005,
    optimizer_s=0.001,
    whole_per_s=95.0,
    waiting_frac=0.02,
)


@pytest.mark.parametrize(
    ("costs", "device", "on_gpu", "words"),
    [
        (replace(EASY, made_per_s=40.0, whole_per_s=40.0, waiting_frac=0.6), "cpu", False, ("starves", "workers: 3")),
        (replace(EASY, made_per_s=40.0, whole_per_s=40.0, waiting_frac=0.6), "cuda", False, ("compose: gpu",)),
        (replace(EASY, waiting_frac=0.4), "cuda", True, ("on the GPU", "raise batch")),
        (replace(EASY, optimizer_s=0.005), "cpu", False, ("optimizer", "raise batch")),
        (replace(EASY, whole_per_s=50.0), "cpu", False, ("same cores", "threads + workers")),
        (EASY, "cpu", False, ("Nothing starves", "threads")),
        (EASY, "cuda", True, ("Nothing starves", "batch")),
    ],
)
def test_the_verdict_names_what_to_change(costs: Costs, device: str, on_gpu: bool, words: tuple[str, ...]) -> None:
    said = verdict(costs, Stage(StageKind.JOINT, minutes=1), TrainConfig(), torch.device(device), on_gpu)
    assert all(word in said for word in words), said
    assert said.count(". ") == 0


def test_a_probe_measures_and_keeps_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(NETWORKS, "tiny", TINY)
    write_pack(tmp_path / "pack")
    stages = [
        {"kind": "joint", "minutes": 5, "batch": 2},
        {"kind": "climnet", "minutes": 5, "batch": 2, "patch_px": 64},
    ]
    values = {"network": "tiny", "packs": ["pack"], "threads": 1, "workers": 0, "stages": stages}
    said: list[str] = []
    assert train(values, tmp_path, tmp_path / "out", Options(probe=True, minutes=0.01), said.append)
    assert [line.split(",")[0] for line in said if "samples/s; ms" in line] == ["joint", "climnet"]
    assert all(word in said[1] for word in ("transfer", "forward", "backward", "optimizer", "waiting"))
    assert not (tmp_path / "out").exists()

"""Several processes learn what one would from all their samples; precision follows the hardware."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from tests.tracker import two_processes
from tracker.configs import NETWORKS
from tracker.train.config import Precision, StageKind, TrainConfigError
from tracker.train.devices import Team, assemble, in_bf16
from tracker.train.loop import Run

ROOT = Path(__file__).parents[2]
CPU = torch.device("cpu")


@pytest.mark.slow
@pytest.mark.timeout(400)  # three PyTorchs start, on a machine that may be busy
def test_two_processes_learn_as_one_with_the_doubled_batch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("lightning_fabric", reason="several processes need the extra 'train'")
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    env = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    script = [str(ROOT / "tests" / "tracker" / "two_processes.py"), str(tmp_path)]
    ended = subprocess.run(command + script, env=env, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr[-2000:]
    monkeypatch.setitem(NETWORKS, "tiny", two_processes.TINY)  # restored afterwards
    for kind, parts in (("climnet", ["internet."]), ("joint", ["backbone.", "grader."])):
        first, second = (torch.load(tmp_path / f"{kind}{rank}.pt", weights_only=True) for rank in (0, 1))
        whole = two_processes.learn(kind, tmp_path / "one", Team(CPU), slice(None))
        half = two_processes.learn(kind, tmp_path / "half", Team(CPU), slice(0, two_processes.HALF))
        for part in parts:
            assert _farthest(first, second, part) == 0
            assert _farthest(first, whole, part) < 2e-5
            assert _farthest(half, whole, part) > 2e-4  # the other half did matter


@pytest.mark.parametrize("kind", [k.value for k in StageKind])
def test_everything_that_learns_gets_a_gradient(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes wait for the gradients of all that learns: one without would hold them up."""
    monkeypatch.setitem(NETWORKS, "tiny", two_processes.TINY)
    run = Run(two_processes.config(kind), tmp_path, Team(CPU), print)
    loss, _ = run.loss({k: v[:1] for k, v in two_processes.drawn_batch(0).items()})
    loss.backward()
    assert not [name for name, p in run.learner.named_parameters() if p.requires_grad and p.grad is None]
    assert any(p.grad is not None for p in run.learner.parameters())


def _farthest(a: dict[str, torch.Tensor], b: dict[str, torch.Tensor], part: str) -> float:
    return max((a[k] - b[k]).abs().max().item() for k in a if k.startswith(part) and a[k].is_floating_point())


def test_one_process_needs_no_other_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "lightning_fabric", None)
    monkeypatch.delenv("WORLD_SIZE", raising=False)
    team = assemble(device="cpu")
    assert (team.rank, team.size, team.leads) == (0, 1, True)
    assert team.agree(3.0, False) == (3.0, False)
    with pytest.raises(TrainConfigError, match=r"climrt-gcs\[train\]"):
        assemble(devices=2, device="cpu")


def test_a_gpu_that_is_not_there_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(TrainConfigError, match="no GPU"):
        assemble(device="cuda")


@pytest.mark.parametrize(
    ("able", "precision", "bf16"),
    [
        ({"avx512_bf16": True}, Precision.AUTO, True),
        ({"amx_tile": True}, Precision.AUTO, True),
        ({"avx512_f": True, "avx512_bf16": False}, Precision.AUTO, False),
        ({}, Precision.BF16, True),
        ({"avx512_bf16": True}, Precision.FP32, False),
    ],
)
def test_bf16_only_where_the_cpu_computes_in_it(
    able: dict[str, bool], precision: Precision, bf16: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: able)
    assert in_bf16(precision, CPU) is bf16

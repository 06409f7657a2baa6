"""Runs go on where they stopped, start from other weights, and leave when time or a signal says so."""

import os
import signal
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from tests.tracker.conftest import TINY
from tests.tracker.packs import write_pack
from tracker.configs import NETWORKS
from tracker.network.climrt import ClimRT
from tracker.train import checkpoint
from tracker.train.checkpoint import CheckpointError
from tracker.train.cli import Options, train
from tracker.train.clock import Interruption, Slice, process_age_s
from tracker.train.config import TrainConfig, TrainConfigError
from tracker.train.dataset import Batch
from tracker.train.devices import Team
from tracker.train.loop import Run
from tracker.train.pack import Imagery, load
from tracker.weights import save

CPU = Team(torch.device("cpu"))
VALUES = {
    "network": "tiny",
    "packs": ["pack"],
    "threads": 1,
    "workers": 0,
    "warmup_steps": 1,
    "precision": "fp32",
    "stages": [{"kind": "joint", "steps": 100, "batch": 2}],
}


@pytest.fixture(autouse=True)
def tiny_network(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(NETWORKS, "tiny", TINY)
    monkeypatch.setitem(NETWORKS, "lean", replace(TINY, name="lean", climnet=None))


@pytest.fixture(scope="module")
def imagery(tmp_path_factory: pytest.TempPathFactory) -> Imagery:
    return load([write_pack(tmp_path_factory.mktemp("data") / "pack")])


def a_run(folder: Path, **values: object) -> Run:
    return Run(TrainConfig.from_dict({**VALUES, **values}), folder, CPU, lambda _: None)


def some_steps(run: Run, source: Iterator[Batch], count: int) -> list[float]:
    losses = []
    for _ in range(count):
        losses.append(run.step(next(source))["loc"])
        run.position.count(run.stage.batch, 1.0)
    return losses


def test_the_same_seed_takes_the_same_first_steps(imagery: Imagery, tmp_path: Path) -> None:
    losses = []
    for i, seed in enumerate((5, 5, 6)):
        run = a_run(tmp_path / str(i), seed=seed)
        losses.append(some_steps(run, run._feed(imagery), 2))
    first, second, other = losses
    assert first == second
    assert first != other


def test_a_resumed_run_goes_on_as_if_it_had_never_stopped(imagery: Imagery, tmp_path: Path) -> None:
    one = a_run(tmp_path / "one")
    some_steps(one, one._feed(imagery), 1)
    one.save("last.pt")
    batch = next(one._feed(imagery))
    expected = one.step(batch)  # with dropout, and a throw of the dice for the latent frame
    other = a_run(tmp_path / "other")
    checkpoint.resume(other, tmp_path / "one" / "last.pt")
    assert other.position.samples == one.position.samples
    assert other.step(batch) == expected
    weights = zip(one.average.state_dict().values(), other.average.state_dict().values(), strict=True)
    assert all(torch.equal(a, b) for a, b in weights)


def test_a_new_schedule_starts_from_the_averaged_weights(imagery: Imagery, tmp_path: Path) -> None:
    one = a_run(tmp_path / "one")
    some_steps(one, one._feed(imagery), 1)
    one.save("last.pt")
    other = a_run(tmp_path / "other", seed=9, stages=[{"kind": "climnet", "minutes": 1}])
    said = checkpoint.start_from(other, str(tmp_path / "one" / "last.pt"))
    assert "the backbone taken, ClimNet taken, the grader taken" in said
    assert other.position.samples == 2
    assert other.position.step == 0
    for network in (other.network, other.average):
        assert torch.equal(network.grader.cls2.weight, one.average.grader.cls2.weight)


def test_what_a_start_lacks_is_named(tmp_path: Path) -> None:
    save(tmp_path / "lean.safetensors", ClimRT(NETWORKS["lean"]), {"samples": 700}, half=True)
    run = a_run(tmp_path / "run")
    fresh = run.network.internet.outconv[1].weight.clone()
    said = checkpoint.start_from(run, str(tmp_path / "lean.safetensors"))
    assert "ClimNet is not in it: begins anew" in said
    assert "700 samples" in said
    assert torch.equal(run.network.internet.outconv[1].weight, fresh)
    compact = a_run(tmp_path / "compact", network="compact")
    with pytest.raises(CheckpointError, match="nothing in it fits"):
        checkpoint.start_from(compact, str(tmp_path / "lean.safetensors"))


@pytest.mark.parametrize(("name", "word"), [("none.pt", "no such checkpoint"), ("text.pt", "cannot be read")])
def test_an_unusable_start_is_one_line(name: str, word: str, tmp_path: Path) -> None:
    (tmp_path / "text.pt").write_text("nothing")
    with pytest.raises(CheckpointError, match=word) as caught:
        checkpoint.start_from(a_run(tmp_path / "run"), str(tmp_path / name))
    assert "\n" not in str(caught.value)


def test_a_run_is_not_written_over_by_mistake(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "last.pt").write_bytes(b"")
    with pytest.raises(TrainConfigError, match="--resume"):
        train(VALUES, tmp_path, tmp_path / "run", Options(), lambda _: None)


def test_a_slice_leaves_room_for_saving_and_skips_what_does_not_fit() -> None:
    slice_ = Slice(end_s=100.0)
    slice_.step_s, slice_.save_s, slice_.examination_s = 5.0, 1.0, 20.0
    assert not slice_.over(88.0)
    assert slice_.over(90.0)
    assert slice_.holds_examination(69.0)
    assert not slice_.holds_examination(75.0)


def test_a_slice_counts_from_the_start_of_the_process() -> None:
    assert process_age_s() > 0
    assert Slice.of(1.0).end_s < time.monotonic() + 60


def test_a_signal_is_noted_once_and_then_acts_as_ever() -> None:
    before, interrupt = signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)
    with Interruption() as asked:
        assert not asked.stop
        os.kill(os.getpid(), signal.SIGTERM)
        assert asked.stop
        assert signal.getsignal(signal.SIGTERM) is before
    assert signal.getsignal(signal.SIGINT) is interrupt


def test_an_interrupted_run_saves_and_says_so_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_pack(tmp_path / "pack")
    step = Run.step

    def interrupted_step(run: Run, batch: Batch) -> dict[str, float]:
        os.kill(os.getpid(), signal.SIGINT)
        return step(run, batch)

    monkeypatch.setattr(Run, "step", interrupted_step)
    said: list[str] = []
    assert not train(VALUES, tmp_path, tmp_path / "run", Options(), said.append)
    assert sum("interrupted" in line for line in said) == 1
    assert checkpoint.read(tmp_path / "run" / "last.pt")["position"][1] == 1
    assert not (tmp_path / "run" / "weights.safetensors").exists()


def test_a_stage_begins_with_the_average_and_keeps_what_is_still(imagery: Imagery, tmp_path: Path) -> None:
    stages = [{"kind": "joint", "steps": 1, "batch": 2}, {"kind": "heads", "steps": 1, "batch": 2}]
    run = a_run(tmp_path / "run", stages=stages, ema_decay=0.5)
    some_steps(run, run._feed(imagery), 1)
    run.next_stage()
    before = run.average.backbone.layer5[0].weight.clone()
    assert torch.equal(run.network.backbone.layer5[0].weight, before)
    grader = run.average.grader.cls2.weight.clone()
    run.step(next(run._feed(imagery)))
    assert torch.equal(run.average.backbone.layer5[0].weight, before)
    assert torch.equal(run.network.backbone.layer5[1].running_mean, run.average.backbone.layer5[1].running_mean)
    assert not torch.equal(run.average.grader.cls2.weight, grader)


def test_a_gradient_that_is_not_finite_is_left_out(imagery: Imagery, tmp_path: Path) -> None:
    run = a_run(tmp_path / "run")
    before = run.network.grader.cls2.weight.clone()
    batch = next(run._feed(imagery))
    batch["label_cls2"] = torch.full_like(batch["label_cls2"], float("nan"))
    run.step(batch)
    assert torch.equal(run.network.grader.cls2.weight, before)

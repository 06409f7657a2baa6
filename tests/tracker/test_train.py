"""The training loop learns, stops, and goes on from where it was."""

import csv
from pathlib import Path

import pytest
import torch

from tests.tracker.conftest import TINY
from tests.tracker.packs import write_pack
from tracker.configs import COMPACT, NETWORKS
from tracker.train.checkpoint import CheckpointError, resume
from tracker.train.cli import Options, train
from tracker.train.config import StageKind, TrainConfig, TrainConfigError
from tracker.train.devices import Team
from tracker.train.export import export
from tracker.train.loop import Run
from tracker.train.schedule import Position
from tracker.train.siamese import SiameseResponse, response_labels, siamese_loss
from tracker.train.validation import Examiner
from tracker.weights import load_network, read_manifest

CPU = Team(torch.device("cpu"))
SHORT = {
    "network": "tiny",
    "threads": 1,
    "packs": ["pack"],
    "stages": [
        {"kind": "backbone", "minutes": 1, "steps": 1, "batch": 2},
        {"kind": "joint", "minutes": 1, "steps": 2, "batch": 2},
    ],
    "workers": 0,
    "validation_samples": 32,
    "warmup_steps": 1,
}


@pytest.fixture(autouse=True)
def tiny_network(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(NETWORKS, "tiny", TINY)


def write_data(folder: Path) -> Path:
    """A folder with a pack, half of whose pictures are held out, and where they are from."""
    records = write_pack(folder / "pack") / "pack.json"
    records.write_text(records.read_text().replace('"split": "train"', '"split": "val"', 2))
    (folder / "sources.csv").write_text("part,repository,commit,licence,tier,files\ndrawn,ours,1,CC0,A,6\n")
    return folder


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return write_data(tmp_path)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run whose schedule is done."""
    folder = write_data(tmp_path_factory.mktemp("data"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(NETWORKS, "tiny", TINY)
        assert train(SHORT, folder, folder / "run", Options(), lambda _: None)
    return folder / "run"


def test_a_whole_schedule_leaves_a_checkpoint_a_log_and_the_best(finished: Path) -> None:
    left = {path.name for path in finished.iterdir()}
    assert {"last.pt", "best.pt", "best_backbone.pt", "curves.png", "config.json"} <= left
    assert {"samples_1_backbone.png", "samples_2_joint.png"} <= left
    rows = list(csv.DictReader((finished / "log.csv").open()))
    assert rows[-1]["stage"] == "validation"
    assert 0 <= float(rows[-1]["mean_iou"]) <= 1


def test_out_of_time_stops_and_resume_goes_on(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Examiner, "examine", lambda *_: {})  # examining has tests of its own
    said: list[str] = []
    assert not train(SHORT, data, data / "run", Options(minutes=0.0), said.append)  # one step, then the time is up
    assert train(SHORT, data, data / "run", Options(resume=True), said.append)
    assert any("going on from" in line for line in said)
    steps = len((data / "run" / "log.csv").read_text().splitlines())
    assert train(SHORT, data, data / "run", Options(resume=True), said.append)  # done is done
    assert len((data / "run" / "log.csv").read_text().splitlines()) == steps


def test_a_checkpoint_carries_everything(data: Path) -> None:
    config = TrainConfig.from_dict(SHORT)
    run = Run(config, data / "run", CPU, lambda _: None)
    run.position = Position(stage=1, step=5, samples=77)
    run.enter_stage()
    run.save("last.pt")
    other = Run(config, data / "other", CPU, lambda _: None)
    with torch.no_grad():
        other.network.grader.cls2.weight.zero_()
    resume(other, data / "run" / "last.pt")
    assert other.position == run.position
    assert torch.equal(other.network.grader.cls2.weight, run.network.grader.cls2.weight)


def test_foreign_checkpoint_is_refused_in_one_line(data: Path) -> None:
    torch.save({"network": {}}, data / "foreign.pt")
    run = Run(TrainConfig.from_dict(SHORT), data / "run", CPU, lambda _: None)
    with pytest.raises(CheckpointError, match="not a checkpoint of this run"):
        resume(run, data / "foreign.pt")


@pytest.mark.parametrize(
    ("values", "word"),
    [({"speed": 1}, "speed"), ({"network": "huge"}, "huge"), ({"stages": [{"kind": "x", "minutes": 1}]}, "stages")],
)
def test_configuration_errors_name_the_key(values: dict, word: str) -> None:
    with pytest.raises(TrainConfigError, match=word):
        TrainConfig.from_dict(values)


def test_configuration_survives_json() -> None:
    config = TrainConfig.from_dict(SHORT)
    assert TrainConfig.from_dict(config.to_dict()) == config
    assert config.stages[1].kind is StageKind.JOINT


def test_response_labels_peak_at_the_box() -> None:
    labels = response_labels(torch.tensor([[143 + 16.0, 143 - 40.0, 143 + 32.0, 143 - 24.0]]))
    assert labels[0, 10 - 4, 10 + 3] == 1
    assert labels[0, 10, 10] == 0
    assert 5 < labels.sum() < 15


def test_siamese_loss_falls_as_the_peak_rises() -> None:
    box, there = torch.tensor([[135.0, 135, 151, 151]] * 2), torch.ones(2)
    flat = torch.zeros(2, 2, 2, 21, 21)
    peaked = torch.full_like(flat, -4.0)
    for i in range(2):
        peaked[:, i, i, 9:12, 9:12] = 4.0
    assert siamese_loss(peaked, box, there, 0.2) < 0.3 * siamese_loss(flat, box, there, 0.2)


def test_response_relates_every_search_to_every_template() -> None:
    response = SiameseResponse(COMPACT.backbone_channels[3:])
    c4, c5 = COMPACT.backbone_channels[3:]
    search = torch.randn(3, c4, 28, 28), torch.randn(3, c5, 26, 26)
    template = torch.randn(3, c4, 8, 8), torch.randn(3, c5, 6, 6)
    assert response(search, template).shape == (2, 3, 3, 21, 21)


def test_weights_come_out_with_where_they_come_from(finished: Path) -> None:
    manifest = read_manifest(finished / "weights.safetensors")
    assert manifest.extra["data"] == [{"part": "drawn", "repository": "ours", "licence": "CC0"}]
    assert manifest.extra["seed"] == 1
    assert manifest.parts == ("backbone", "grader")  # an untrained ClimNet does not ship
    assert load_network(finished / "weights.safetensors").internet is None


def test_export_of_another_file_is_refused(data: Path) -> None:
    torch.save({"config": "{}"}, data / "other.pt")
    with pytest.raises(ValueError, match="not a training checkpoint"):
        export(data / "other.pt", data / "out.safetensors", data)

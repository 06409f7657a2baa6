"""Learning rates and optimizers: ours, and the authors' table."""

from itertools import pairwise
from pathlib import Path

import pytest
import torch
import yaml

import tracker.train
from tests.tracker.conftest import TINY
from tracker.network.climrt import ClimRT
from tracker.train.config import Optimizer, Stage, StageKind, TrainConfig
from tracker.train.schedule import (
    Position,
    cosine_factor,
    make_optimizer,
    make_plateau,
    paper_factor,
    rate,
    set_modes,
)
from tracker.train.siamese import SiameseResponse


@pytest.fixture
def parts() -> tuple[ClimRT, SiameseResponse]:
    return ClimRT(TINY), SiameseResponse(TINY.backbone_channels[3:])


def test_the_paper_table() -> None:
    grader = [3e-3 * paper_factor(epoch) for epoch in range(70)]
    assert grader[0] == pytest.approx(1.5e-3)
    assert grader[4] == pytest.approx(2.6e-3, rel=0.01)
    assert grader[5] == pytest.approx(3e-3)
    assert grader[69] == pytest.approx(3e-5)
    assert all(b > a for a, b in pairwise(grader[:5]))
    ratios = [b / a for a, b in pairwise(grader[5:])]
    assert max(ratios) == pytest.approx(min(ratios))  # evenly in the logarithm
    assert paper_factor(200) == paper_factor(69)


def test_the_paper_settings_give_its_rates_to_both_groups(parts: tuple[ClimRT, SiameseResponse]) -> None:
    path = Path(tracker.train.__file__).parent / "paper.yaml"
    config = TrainConfig.from_dict(yaml.safe_load(path.read_text(encoding="utf-8")))
    stage = next(s for s in config.stages if s.kind is StageKind.JOINT)
    optimizer = make_optimizer(stage, config, *parts)
    assert isinstance(optimizer, torch.optim.SGD)
    assert {g["momentum"] for g in optimizer.param_groups} == {0.9}
    assert {g["weight_decay"] for g in optimizer.param_groups} == {1e-4}
    tenth = int(config.epoch_samples * 10.5)
    now = rate(stage, config, Position(stage_samples=tenth), optimizer)
    assert now == pytest.approx(3e-3 * 0.01 ** (5 / 64))
    backbone = {id(p) for p in parts[0].backbone.parameters()}
    for group in optimizer.param_groups:
        is_backbone = {id(p) in backbone for p in group["params"]}
        assert is_backbone == {group["factor"] == 0.1}


def test_layers_keep_still_as_the_stage_says(parts: tuple[ClimRT, SiameseResponse]) -> None:
    network, response = parts
    stage = Stage(StageKind.JOINT, epochs=70, frozen_layers=2, frozen_epochs=10)
    set_modes(stage, network, response, thawed=False)
    assert not any(p.requires_grad for p in network.backbone.parameters())
    assert not any(m.training for layer in list(network.backbone.children()) for m in layer.modules())
    set_modes(stage, network, response, thawed=True)
    assert not network.backbone.layer2[0].weight.requires_grad
    assert not network.backbone.layer2[1].training
    assert network.backbone.layer3[0].weight.requires_grad
    assert network.backbone.layer3[1].training
    set_modes(Stage(StageKind.HEADS, minutes=1), network, response)
    learning = {n.split(".")[0] for n, p in network.named_parameters() if p.requires_grad}
    assert learning == {"grader"}
    assert not any(p.requires_grad for p in response.parameters())


def test_cosine_warms_up_and_ends_at_a_hundredth() -> None:
    assert cosine_factor(0.0, 0, 100) == pytest.approx(0.01)
    assert cosine_factor(0.0, 99, 100) == pytest.approx(1.0)
    assert cosine_factor(1.0, 500, 100) == pytest.approx(0.01)
    assert cosine_factor(0.5, 500, 100) == pytest.approx(0.505)


def test_plateau_halves_after_five_validations_without_news(parts: tuple[ClimRT, SiameseResponse]) -> None:
    stage = Stage(StageKind.CLIMNET, minutes=1, learning_rate=2e-3, optimizer=Optimizer.ADAM)
    optimizer = make_optimizer(stage, TrainConfig(), *parts)
    assert isinstance(optimizer, torch.optim.Adam)
    plateau = make_plateau(optimizer)
    for score in (10.0, *[9.0] * 5):
        plateau.step(score)
    assert optimizer.param_groups[0]["lr"] == 2e-3
    plateau.step(9.0)
    assert optimizer.param_groups[0]["lr"] == 1e-3


def test_decay_spares_norms_and_positions_with_adamw_only(parts: tuple[ClimRT, SiameseResponse]) -> None:
    table = parts[0].grader.row_embed.weight
    for kind, spared in ((Optimizer.ADAMW, True), (Optimizer.SGD, False)):
        optimizer = make_optimizer(Stage(StageKind.JOINT, minutes=1, optimizer=kind), TrainConfig(), *parts)
        decay = next(g["weight_decay"] for g in optimizer.param_groups if any(p is table for p in g["params"]))
        assert (decay == 0) == spared


@pytest.mark.parametrize(
    ("stage", "position", "done"),
    [
        (Stage(StageKind.JOINT, minutes=2), Position(seconds=30.0), 0.25),
        (Stage(StageKind.JOINT, steps=8), Position(step=2), 0.25),
        (Stage(StageKind.JOINT, epochs=2), Position(stage_samples=300_000), 0.25),
    ],
)
def test_how_much_of_a_stage_is_done(stage: Stage, position: Position, done: float) -> None:
    assert position.done(stage, TrainConfig()) == done

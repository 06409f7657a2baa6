"""The settings that ship can be used as they are."""

from dataclasses import replace
from pathlib import Path

import pytest
import yaml

import tracker.train
from tracker.configs import COMPACT, NETWORKS
from tracker.train.config import StageKind, TrainConfig, TrainConfigError

# The ablations' settings are of another kind (tracker.train.ablation_config).
FILES = sorted(p for p in Path(tracker.train.__file__).parent.glob("*.yaml") if p.stem != "ablation")


def _read(name: str) -> TrainConfig:
    path = Path(tracker.train.__file__).parent / f"{name}.yaml"
    return TrainConfig.from_dict(yaml.safe_load(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_the_shipped_settings_are_usable(path: Path) -> None:
    config = _read(path.stem)
    for stage in config.stages:
        config.recipe_of(stage)
    assert TrainConfig.from_dict(config.to_dict()) == config


def test_every_kind_of_settings_ships() -> None:
    assert {"compact", "full", "gpu", "paper"} <= {p.stem for p in FILES}
    assert _read("compact").network == "compact"
    assert _read("full").network == "full"


def test_the_gpu_settings_fit_slots_of_nine_minutes() -> None:
    assert all(stage.minutes < 9 for stage in _read("gpu").stages)
    assert _read("gpu").stages[0].kind is StageKind.BACKBONE


def test_a_network_without_climnet_has_no_such_stage(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(NETWORKS, "lean", replace(COMPACT, climnet=None))
    with pytest.raises(TrainConfigError, match="lean has no ClimNet"):
        TrainConfig.from_dict({"network": "lean", "stages": [{"kind": "climnet", "minutes": 1}]})


@pytest.mark.parametrize(
    ("stage", "word"),
    [
        ({"kind": "joint"}, "minutes"),
        ({"kind": "joint", "minutes": 1, "speed": 3}, "unknown key 'speed'"),
        ({"kind": "climnet", "minutes": 1, "patch_px": 100}, "multiple of 32"),
        ({"kind": "joint", "minutes": 1, "optimizer": "lion"}, "adamw, sgd, adam"),
        ({"kind": "joint", "minutes": 1, "frozen_epochs": 3}, "epochs"),
        ({"kind": "joint", "minutes": 1, "recipe": {"fog": 1}}, "fog"),
        ({"minutes": 1}, "no kind"),
    ],
)
def test_an_unusable_stage_is_one_line_with_its_key(stage: dict, word: str) -> None:
    with pytest.raises(TrainConfigError, match=word):
        TrainConfig.from_dict({"stages": [stage]})

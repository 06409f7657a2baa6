"""The settings that ship can be used as they are."""

from pathlib import Path

import yaml

import tracker.train
from tracker.train.compose import Recipe
from tracker.train.config import TrainConfig


def test_the_shipped_settings_are_usable() -> None:
    config = TrainConfig.from_dict(yaml.safe_load((Path(tracker.train.__file__).parent / "compact.yaml").read_text()))
    assert config.network == "compact"
    assert Recipe(**config.recipe).scale_std == 0.24

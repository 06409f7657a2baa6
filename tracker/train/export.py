"""From a run's checkpoint to weights that can be shipped: averaged weights, with where they come from."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from tracker.configs import NETWORKS, NetworkConfig, TrackerConfig
from tracker.network.climrt import ClimRT
from tracker.train.config import StageKind, TrainConfig
from tracker.train.datasets import credits_of_sets
from tracker.weights import save

# The constants that suit weights of this training: probabilities, a clipped rate, sizes calibrated.
TRAINED = TrackerConfig(
    cls2_is_logit=False,
    clip_rate=True,
    calibrate=True,
    size_rate=0.04,
    lost_below=0.5,
    found_above=0.75,
    filter_weight=0.2,
    filter_share=0.7,
    sure_above=0.6,
    doubt_below=0.35,
    redetect=True,
)


def credits_of(data: Path, packs: Sequence[str | Mapping[str, Any]]) -> list[dict[str, str]]:
    """Part, source and licence of the pictures, from the packs' sources.csv where there is one, and the data sets."""
    table = data / "sources.csv"
    own = [pack for pack in packs if isinstance(pack, str)]
    if not table.exists():
        credits = [{"part": pack} for pack in own]
    else:
        with table.open(newline="") as file:
            rows = [{k: row[k] for k in ("part", "repository", "licence")} for row in csv.DictReader(file)]
        credits = rows if own else []
    return credits + credits_of_sets(packs)


def _trained_parts(config: TrainConfig) -> NetworkConfig:
    """The network without ClimNet where the run did not train it: an untrained one draws noise."""
    network = NETWORKS[config.network]
    trained = any(stage.kind is StageKind.CLIMNET for stage in config.stages)
    return network if trained else replace(network, climnet=None)


def export(
    checkpoint: Path,
    out: Path,
    data: Path,
    *,
    tracker: TrackerConfig = TRAINED,
    metrics: Mapping[str, Any] | None = None,
) -> Path:
    """Write the averaged weights of a checkpoint as safetensors with their manifest; returns the path.

    Raises ValueError for a file that is no checkpoint of tracker.train.loop.
    """
    state = torch.load(checkpoint, weights_only=True, map_location="cpu")
    try:
        config = TrainConfig.from_dict(json.loads(state["config"]))
        network, tensors = ClimRT(_trained_parts(config)), state["average"]
        if network.internet is None:
            tensors = {k: v for k, v in tensors.items() if not k.startswith("internet.")}
        network.load_state_dict(tensors)
        samples = int(state["position"][3])
    except (KeyError, RuntimeError) as error:
        raise ValueError(f"{checkpoint}: not a training checkpoint ({str(error).splitlines()[0]})") from error
    extra = {
        "training": config.to_dict(),
        "seed": config.seed,
        "samples": samples,
        "data": credits_of(data, config.packs),
        "metrics": dict(metrics or {}),
    }
    return save(out, network, extra, tracker=tracker, half=True)

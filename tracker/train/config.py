"""What a training run is made of: plain values, from a mapping, validated once."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from enum import Enum
from typing import Any

from tracker.configs import NETWORKS


class TrainConfigError(ValueError):
    """A training configuration is not usable; the message names the key and the value."""


class StageKind(Enum):
    """What a stage trains."""

    BACKBONE = "backbone"  # the backbone alone, by the plain correlation response
    JOINT = "joint"  # backbone and heads, exact boxes
    CLIMNET = "climnet"  # the latent frame's network alone


@dataclass(frozen=True)
class Stage:
    """One stage: how long (minutes of training time, or steps where given) and how fast it learns."""

    kind: StageKind
    minutes: float
    steps: int = 0
    batch: int = 32
    learning_rate: float = 1e-3
    latent_previous_frac: float = 0.5  # share of batches whose latent frame is the previous patch
    frozen_layers: int = 0  # first layers of the backbone that keep still, statistics included


@dataclass(frozen=True)
class TrainConfig:
    """A run: network preset, data packs, stages, and what the loop does besides."""

    network: str = "compact"
    packs: tuple[str, ...] = ("shard1.tar", "shard2.tar", "shard3.tar", "shard4.tar", "davis.tar")
    stages: tuple[Stage, ...] = (Stage(StageKind.BACKBONE, 12.0), Stage(StageKind.JOINT, 78.0))
    seed: int = 1
    workers: int = 1
    threads: int = 2
    weight_decay: float = 1e-2
    warmup_steps: int = 300
    ema_decay: float = 0.999
    gradient_clip: float = 5.0
    auxiliary_weight: float = 0.3
    cross_negative_weight: float = 0.2
    validate_minutes: float = 5.0
    checkpoint_minutes: float = 2.0
    validation_samples: int = 256
    recipe: dict[str, float] = field(default_factory=dict)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> TrainConfig:
        """From plain values; raises TrainConfigError on an unknown key or an unusable value."""
        known = {f.name for f in fields(cls)}
        if unknown := sorted(set(values) - known):
            raise TrainConfigError(f"unknown training key {unknown[0]!r}; known: {', '.join(sorted(known))}")
        values = dict(values)
        if values.get("network", "compact") not in NETWORKS:
            raise TrainConfigError(f"network = {values['network']!r}: known are {', '.join(NETWORKS)}")
        try:
            if "stages" in values:
                values["stages"] = tuple(Stage(**{**s, "kind": StageKind(s["kind"])}) for s in values["stages"])
            if "packs" in values:
                values["packs"] = tuple(values["packs"])
        except (TypeError, ValueError, KeyError) as error:
            raise TrainConfigError(f"stages: {error}") from error
        return cls(**values)

    def to_dict(self) -> dict[str, Any]:
        """As plain JSON values."""
        out = asdict(self)
        for stage in out["stages"]:
            stage["kind"] = stage["kind"].value
        return out

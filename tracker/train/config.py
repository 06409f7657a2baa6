"""What a training run is made of: plain values, from a mapping, validated once."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from enum import Enum
from typing import Any

from tracker.configs import NETWORKS
from tracker.train.compose import Recipe


class TrainConfigError(ValueError):
    """A training configuration is not usable; the message names the key and the value."""


def _require(condition: bool, key: str, value: object, wanted: str) -> None:
    if not condition:
        raise TrainConfigError(f"{key} = {value!r}: must be {wanted}")


class StageKind(Enum):
    """What a stage trains."""

    BACKBONE = "backbone"  # the backbone alone, by the plain correlation response
    HEADS = "heads"  # the grader alone on a backbone that keeps still
    JOINT = "joint"  # backbone and heads, exact boxes
    CLIMNET = "climnet"  # the latent frame's network alone


class Optimizer(Enum):
    """Who takes the steps. Decay: adamw spares biases, norms and tables; sgd and adam, as the authors', do not."""

    ADAMW = "adamw"  # betas 0.9, 0.98
    SGD = "sgd"  # momentum 0.9
    ADAM = "adam"  # betas 0.9, 0.99


class Schedule(Enum):
    """How the learning rate goes over a stage (tracker.train.schedule)."""

    COSINE = "cosine"  # warm-up by steps, then half a cosine down to a hundredth
    PAPER = "paper"  # 5 epochs from a half to 0.87, then from 1 to a hundredth, evenly in the logarithm
    PLATEAU = "plateau"  # halved when 5 validations in a row bring nothing new


class Precision(Enum):
    """Numbers of the forward pass."""

    AUTO = "auto"  # bf16 on GPUs and on CPUs that compute in it, else fp32
    BF16 = "bf16"
    FP32 = "fp32"


class Compose(Enum):
    """Where samples are made."""

    AUTO = "auto"  # on the GPU where there is one
    CPU = "cpu"  # by worker processes
    GPU = "gpu"


@dataclass(frozen=True)
class Stage:
    """One stage: how long it lasts, and how it learns.

    Its length is `epochs` (of TrainConfig.epoch_samples) or `steps` where given, else `minutes` of training time.
    Values left at None are the run's.
    """

    kind: StageKind
    minutes: float = 0.0
    steps: int = 0
    epochs: float = 0.0
    batch: int = 32  # per process
    learning_rate: float = 1e-3
    optimizer: Optimizer = Optimizer.ADAMW
    schedule: Schedule = Schedule.COSINE
    weight_decay: float | None = None
    backbone_rate: float = 1.0  # the backbone's learning rate as a multiple of the others'
    frozen_layers: int = 0  # first layers of the backbone that keep still, statistics included
    frozen_epochs: float = 0.0  # epochs in which the whole backbone keeps still
    latent_previous_frac: float = 0.5  # share of batches whose latent frame is the previous patch
    patch_px: int = 0  # side of ClimNet's training patches, a multiple of 32; 0 = whole search patches
    real_frac: float = 0.5  # share of ClimNet's triplets that are adjacent frames of clips
    recipe: dict[str, float] = field(default_factory=dict)  # over the run's recipe

    def __post_init__(self) -> None:
        _require(max(self.minutes, self.steps, self.epochs) > 0, "minutes", self.minutes, "or steps or epochs, over 0")
        _require(min(self.minutes, self.steps, self.epochs) >= 0, "minutes", self.minutes, "zero or more")
        _require(self.batch > 0, "batch", self.batch, "over 0")
        _require(self.learning_rate > 0, "learning_rate", self.learning_rate, "over 0")
        _require(0 <= self.frozen_layers <= 5, "frozen_layers", self.frozen_layers, "in 0..5")
        _require(self.patch_px in range(0, 257, 32), "patch_px", self.patch_px, "a multiple of 32, at most 256")
        _require(0 <= self.real_frac <= 1, "real_frac", self.real_frac, "in 0..1")
        _require(not self.frozen_epochs or self.epochs > 0, "frozen_epochs", self.frozen_epochs, "used with epochs")


@dataclass(frozen=True)
class TrainConfig:
    """A run: network preset, data packs, stages, and what the loop does besides."""

    network: str = "compact"
    packs: tuple[str, ...] = ("shard1.tar", "shard2.tar", "shard3.tar", "shard4.tar", "davis.tar")
    stages: tuple[Stage, ...] = (Stage(StageKind.BACKBONE, 12.0), Stage(StageKind.JOINT, 78.0))
    start_from: str = ""  # checkpoint (.pt), weights file (.safetensors) or shipped name whose weights come first
    seed: int = 1
    workers: int = 1
    threads: int = 2
    precision: Precision = Precision.AUTO
    compose: Compose = Compose.AUTO
    tensorboard: bool = False
    epoch_samples: int = 600_000
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

    def __post_init__(self) -> None:
        _require(self.network in NETWORKS, "network", self.network, f"one of {', '.join(NETWORKS)}")
        _require(bool(self.stages), "stages", self.stages, "one at least")
        interpolates = any(stage.kind is StageKind.CLIMNET for stage in self.stages)
        has_climnet = NETWORKS[self.network].climnet is not None
        _require(has_climnet or not interpolates, "stages", "climnet", f"none: network {self.network} has no ClimNet")
        _require(self.workers >= 0, "workers", self.workers, "zero or more")
        _require(self.threads > 0, "threads", self.threads, "over 0")
        _require(self.warmup_steps > 0, "warmup_steps", self.warmup_steps, "over 0")
        for recipe in (self.recipe, *(stage.recipe for stage in self.stages)):
            unknown = sorted(set(recipe) - {f.name for f in fields(Recipe)})
            _require(not unknown, "recipe", "".join(unknown[:1]), "of keys of tracker.train.compose.Recipe")

    def recipe_of(self, stage: Stage) -> Recipe:
        """Shares and strengths of everything random in the stage's samples."""
        return Recipe(**{**self.recipe, **stage.recipe})

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> TrainConfig:
        """From plain values; raises TrainConfigError on an unknown key or an unusable value."""
        known = {f.name for f in fields(cls)}
        if unknown := sorted(set(values) - known):
            raise TrainConfigError(f"unknown training key {unknown[0]!r}; known: {', '.join(sorted(known))}")
        values = dict(values)
        try:
            if "stages" in values:
                values["stages"] = tuple(_stage(s) for s in values["stages"])
            if "packs" in values:
                values["packs"] = tuple(values["packs"])
            for key, choices in (("precision", Precision), ("compose", Compose)):
                if key in values:
                    values[key] = _choice(choices, key, values[key])
            return cls(**values)
        except (TypeError, KeyError, AttributeError) as error:
            raise TrainConfigError(f"training configuration is malformed: {error}") from error

    def to_dict(self) -> dict[str, Any]:
        """As plain JSON values."""
        return _plain(asdict(self))


def _stage(values: dict[str, Any]) -> Stage:
    known = {f.name for f in fields(Stage)}
    if unknown := sorted(set(values) - known):
        raise TrainConfigError(f"stages: unknown key {unknown[0]!r}; known: {', '.join(sorted(known))}")
    if "kind" not in values:
        raise TrainConfigError("stages: a stage has no kind")
    kinds = {"kind": StageKind, "optimizer": Optimizer, "schedule": Schedule}
    return Stage(**{k: _choice(kinds[k], f"stages: {k}", v) if k in kinds else v for k, v in values.items()})


def _choice(choices: type[Enum], key: str, value: object) -> Enum:
    try:
        return choices(value)
    except ValueError:
        known = ", ".join(str(c.value) for c in choices)
        raise TrainConfigError(f"{key} = {value!r}: must be one of {known}") from None


def _plain(value: Any) -> Any:
    """Enums as their values, tuples as lists, all the way down."""
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    return [_plain(v) for v in value] if isinstance(value, (list, tuple)) else value

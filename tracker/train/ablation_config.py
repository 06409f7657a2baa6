"""What a run of the paper's ablations is made of: plain values, validated once."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import Enum
from typing import Any

from tracker.configs import ClimNetConfig, ConfigError, Variant
from tracker.train.config import Stage, StageKind, TrainConfig, TrainConfigError

SLIM = ClimNetConfig(stem=8, stages=(8, 16, 32, 64))  # half of compact's widths: a quarter of its work


class EvaluationLatent(Enum):
    """Where variants with a latent frame get it from when they are scored."""

    PREVIOUS = "previous"  # the earlier patch stands in: ClimNet's blocks then make no difference
    CLIMNET = "climnet"  # drawn by each variant's own ClimNet


@dataclass(frozen=True, slots=True)
class AblationConfig:
    """Equal budgets for every variant and seed, counted in samples, not minutes.

    start_from: weights (shipped name or .safetensors) whose backbone all variants share and nobody changes.
    samples, batch, learning_rate, warmup_steps: of training the transformer and heads; all variants of a seed see
    the same samples in the same order. latent_previous_frac: share of batches whose latent frame is the previous
    patch; in the others the true middle frame stands in. recipe: of tracker.train.compose.
    climnet: widths of the variants' ClimNets; climnet_samples, _batch, _patch_px: of training each. climnet_weights:
    instead, weights files that hold a trained ClimNet, by variant (full serves climnet_hift too).
    latent: what stands in when scoring. intervals: the paper's m, for interval_variants, without retraining.
    frames: so many of each sequence, 0 = all. held_out_samples: for the mean IoU that is steadier than tracking.
    """

    start_from: str = "compact"
    variants: tuple[Variant, ...] = tuple(Variant)
    seeds: tuple[int, ...] = (1, 2, 3)
    packs: tuple[str, ...] = TrainConfig.packs
    samples: int = 3200
    batch: int = 32
    learning_rate: float = 1e-3
    warmup_steps: int = 20
    latent_previous_frac: float = 0.5
    recipe: dict[str, float] = field(default_factory=dict)
    climnet: ClimNetConfig = SLIM
    climnet_samples: int = 0
    climnet_batch: int = 16
    climnet_patch_px: int = 64
    climnet_weights: dict[Variant, str] = field(default_factory=dict)
    latent: EvaluationLatent = EvaluationLatent.PREVIOUS
    intervals: tuple[int, ...] = (1,)
    interval_variants: tuple[Variant, ...] = (Variant.FULL,)
    frames: int = 0
    held_out_samples: int = 128
    workers: int = 0
    threads: int = 1

    def __post_init__(self) -> None:
        _require(bool(self.variants) and bool(self.seeds), "variants, seeds", "", "one at least of each")
        _require(len(set(self.seeds)) == len(self.seeds), "seeds", list(self.seeds), "all different")
        _require(self.samples >= self.batch > 0, "samples", self.samples, "a batch at least")
        _require(1 in self.intervals, "intervals", list(self.intervals), "1 among them")
        _require(all(1 <= m <= 5 for m in self.intervals), "intervals", list(self.intervals), "in 1..5")
        _require(all(v.uses_latent for v in self.interval_variants), "interval_variants", "", "variants with latent")
        _require(self.frames == 0 or self.frames > 1, "frames", self.frames, "0 or over 1")
        for key in ("climnet_samples", "held_out_samples", "workers"):
            _require(getattr(self, key) >= 0, key, getattr(self, key), "zero or more")
        narrowest = min(self.climnet.stem, self.climnet.stages[0])
        _require(narrowest >= 6, "climnet", narrowest, "6 wide at least: it begins as the mean of both frames")
        _require(self.threads > 0, "threads", self.threads, "over 0")
        _require(set(self.climnet_weights) <= set(map(climnet_of, Variant)), "climnet_weights", "", "of " + _DESIGNS)
        if self.latent is EvaluationLatent.CLIMNET and not self.climnet_samples:
            lacking = {climnet_of(v) for v in self.variants if v.uses_latent} - set(self.climnet_weights)
            names = ", ".join(sorted(v.value for v in lacking))
            _require(not lacking, "latent", "climnet", f"given climnet_samples, or climnet_weights of {names}")
        self.training(self.seeds[0])  # for its own complaints

    def training(self, seed: int) -> TrainConfig:
        """The same budget as a training configuration: two stages, for the graders and for ClimNets."""
        steps = max(1, self.climnet_samples // self.climnet_batch)
        heads = Stage(
            StageKind.HEADS, steps=self.samples // self.batch, batch=self.batch, learning_rate=self.learning_rate
        )
        climnet = Stage(StageKind.CLIMNET, steps=steps, batch=self.climnet_batch, patch_px=self.climnet_patch_px)
        return TrainConfig(
            packs=self.packs,
            stages=(heads, climnet),
            seed=seed,
            workers=self.workers,
            threads=self.threads,
            warmup_steps=self.warmup_steps,
            validation_samples=self.held_out_samples,
            recipe=self.recipe,
        )

    def to_dict(self) -> dict[str, Any]:
        """As plain JSON values."""
        values = {f.name: _plain(getattr(self, f.name)) for f in fields(self)}
        return values | {"climnet": {"stem": self.climnet.stem, "stages": list(self.climnet.stages)}}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> AblationConfig:
        """From plain values; raises TrainConfigError on an unknown key or an unusable value."""
        known = {f.name for f in fields(cls)}
        if unknown := sorted(set(values) - known):
            raise TrainConfigError(f"unknown ablation key {unknown[0]!r}; known: {', '.join(sorted(known))}")
        read = {
            "variants": lambda v: tuple(map(Variant, v)),
            "interval_variants": lambda v: tuple(map(Variant, v)),
            "seeds": tuple,
            "packs": tuple,
            "intervals": tuple,
            "latent": EvaluationLatent,
            "climnet": lambda v: ClimNetConfig(v["stem"], tuple(v["stages"])),
            "climnet_weights": lambda v: {Variant(name): str(file) for name, file in v.items()},
        }
        key = ""
        try:
            for key in sorted(set(read) & set(values)):
                values = values | {key: read[key](values[key])}
            key = "configuration"
            return cls(**values)
        except TrainConfigError:
            raise
        except (ConfigError, ValueError, TypeError, KeyError, AttributeError) as error:
            raise TrainConfigError(f"ablation: {key}: {error}") from error


def grader_of(variant: Variant) -> Variant:
    """The variant whose transformer and heads this one has: the ablations of ClimNet's blocks have ClimRT's."""
    return Variant.FULL if variant in (Variant.GSTC_LCT, Variant.MS_FUSION_LCT) else variant


def climnet_of(variant: Variant) -> Variant:
    """The variant whose ClimNet this one has."""
    return variant if variant in (Variant.GSTC_LCT, Variant.MS_FUSION_LCT) else Variant.FULL


_DESIGNS = "full, gstc_lct, ms_fusion_lct"


def _plain(value: Any) -> Any:
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, dict):
        return {_plain(k): _plain(v) for k, v in value.items()}
    return [_plain(v) for v in value] if isinstance(value, tuple) else value


def _require(condition: bool, key: str, value: object, wanted: str) -> None:
    if not condition:
        raise TrainConfigError(f"{key} = {value!r}: must be {wanted}")

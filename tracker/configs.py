"""Configurations of the network and of the online tracker: plain values, validated once."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields, replace
from enum import Enum
from typing import Any, TypeVar

import msgspec

MOST_CHANNELS = 4096  # a manifest must not take all memory before its tensors are even compared
T = TypeVar("T")


class ConfigError(ValueError):
    """A network or tracker configuration is not usable; the message names the field and the value."""


class LatentProvider(Enum):
    """Where the latent frame (the moment between the previous and the current search patch) comes from."""

    CLIMNET = "climnet"  # interpolated by ClimNet, as in the paper
    PREVIOUS = "previous"  # features of the earlier patch itself, as in the released training; costs nothing
    OFF = "off"  # the current patch's own features: no temporal information at all


class Variant(Enum):
    """The whole ClimRT network, or one of the paper's ablations of it (its table on UAVTrack112).

    GSTC and MS fusion are the encoder's and the decoder's blocks of ClimNet: a variant that names only one of
    them has plain 3-D convolutions in the other's place.
    """

    HIFT = "hift"  # the baseline: HiFT's transformer on layers 3, 4 and 5 of the search patch alone
    LCT = "lct"  # the paper's transformer, the search patch's own layer 5 in the latent frame's place
    GSTC_LCT = "gstc_lct"  # latent frame by GSTC blocks and plain upsampling
    MS_FUSION_LCT = "ms_fusion_lct"  # latent frame by plain blocks and MS fusion
    CLIMNET_HIFT = "climnet_hift"  # HiFT's transformer whose decoder starts from the latent frame's layer 5
    FULL = "full"  # ClimNet + LCT: ClimRT

    @property
    def is_hift(self) -> bool:
        """Whether HiFT's transformer joins the similarity maps, not the paper's."""
        return self in (Variant.HIFT, Variant.CLIMNET_HIFT)

    @property
    def uses_latent(self) -> bool:
        """Whether a latent frame enters the network at all."""
        return self not in (Variant.HIFT, Variant.LCT)

    @property
    def has_gstc(self) -> bool:
        """Whether ClimNet's encoder is made of ghost spatial-temporal blocks, not plain ones."""
        return self is not Variant.MS_FUSION_LCT

    @property
    def has_ms_fusion(self) -> bool:
        """Whether ClimNet's decoder fuses scales, not only upsamples."""
        return self is not Variant.GSTC_LCT


@dataclass(frozen=True, slots=True)
class ClimNetConfig:
    """Widths of ClimNet: channels of the first stem convolution and of the four encoder stages."""

    stem: int
    stages: tuple[int, int, int, int]

    def __post_init__(self) -> None:
        _require(0 < self.stem <= MOST_CHANNELS, "climnet.stem", self.stem, "positive and sane")
        sane = len(self.stages) == 4 and min(self.stages) > 0 and _sane(self.stages, MOST_CHANNELS)
        _require(sane, "climnet.stages", self.stages, "4 sane widths > 0")


@dataclass(frozen=True, slots=True)
class NetworkConfig:
    """Shape of one ClimRT network.

    backbone_channels: output channels of the five backbone layers.
    hidden: channels of the transformer (d_model); heads, ffn: of its attention and feed-forward parts.
    group_norm_groups: groups of the head towers' GroupNorm; head_convs: 3x3 convolutions in each tower.
    climnet: widths of ClimNet, or None to build the network without it.
    legacy_layout: True repeats the unpermuted view in the authors' encoder (their checkpoints need it).
    cross_attention_residual: the authors' decoder has none around its cross-attention; True adds it.
    input_mean, input_scale: the backbone sees (x - mean) * scale of BGR 0..255 (the authors: raw).
    variant: the whole network, or one of the paper's ablations of it.
    """

    name: str
    backbone_channels: tuple[int, int, int, int, int]
    hidden: int
    heads: int
    ffn: int
    group_norm_groups: int
    climnet: ClimNetConfig | None
    legacy_layout: bool
    cross_attention_residual: bool = False
    head_convs: int = 3
    dropout: float = 0.1
    input_mean: float = 0.0
    input_scale: float = 1.0
    variant: Variant = Variant.FULL

    def __post_init__(self) -> None:
        widths = self.backbone_channels
        sane = len(widths) == 5 and min(widths) > 0 and _sane(widths, MOST_CHANNELS)
        _require(sane, "backbone_channels", widths, "5 sane widths > 0")
        counts = (self.hidden, self.ffn, self.head_convs * 64)  # times 64: no more than 64 convolutions
        _require(_sane(counts, MOST_CHANNELS), "hidden, ffn or head_convs", counts, "sane")
        _require(_sane((self.input_mean, self.input_scale), 1e6), "input_mean or input_scale", "", "sane")
        _require(self.hidden > 0 and self.hidden % 2 == 0, "hidden", self.hidden, "positive and even")
        _require(self.heads > 0 and self.hidden % self.heads == 0, "heads", self.heads, "a divisor of hidden")
        _require(self.ffn > 0, "ffn", self.ffn, "positive")
        groups = self.group_norm_groups
        _require(groups > 0 and self.hidden % groups == 0, "group_norm_groups", groups, "a divisor of hidden")
        _require(self.head_convs >= 0, "head_convs", self.head_convs, "zero or more")
        _require(0 <= self.dropout < 1, "dropout", self.dropout, "in [0, 1)")
        _require(self.input_scale != 0, "input_scale", self.input_scale, "other than zero")
        has_use = self.climnet is None or self.variant.uses_latent
        _require(has_use, "climnet", self.climnet, f"none for variant {self.variant.value}")

    def as_variant(self, variant: Variant) -> NetworkConfig:
        """The same widths as an ablation of the paper; ClimNet is left out where no latent frame is used."""
        climnet = self.climnet if variant.uses_latent else None
        return replace(self, name=f"{self.name}-{variant.value}", variant=variant, climnet=climnet)

    def to_dict(self) -> dict[str, Any]:
        """As plain JSON values."""
        return asdict(self) | {"variant": self.variant.value}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> NetworkConfig:
        """From to_dict's values; raises ConfigError on unknown, missing or unusable fields."""
        return _from_dict(cls, values, "network")


@dataclass(frozen=True, slots=True)
class TrackerConfig:
    """Constants of online tracking, the authors' experiments/config.yaml values by default.

    exemplar_px, search_px: sides of the template and search patches fed to the network.
    context_frac: context added round the object, in mean sides. grid_cells, grid_stride_px: the score grid.
    penalty_k, window_influence, size_rate: scale-change penalty, Hann window weight, size smoothing rate.
    cls1_weight, cls2_weight: of the two classification branches in the score. cls2_is_logit: the second
    branch enters the score as a raw logit (the authors' tracker), or as a probability.
    min_size_px: floor of the tracked box's sides in the frame; huge_frac: above this part of the frame's
    area the first frame's crop size is used.
    latent, latent_interval: provider of the latent frame, and how many frames back (1..5) its other
    input lies (the paper's m). clip_rate: clip the smoothing rate to 0..1 (the authors do not).
    calibrate: measure the network's bias in place and size on the first frame, take it out of all others
    (the authors do not).
    lost_below, found_above: score, relative to the track's beginning, under which the object is taken for hidden,
    and from which it is believed to be back, if near where it is looked for (the authors have no such state: 0, 0).
    doubt_below: filter's response, relative to what it was lately, under which the object is not to be seen.
    filter_weight, filter_share: what the correlation filter learned on line counts in choosing the cell, and
    in placing the box's centre, 0..1 (the authors have none: 0, 0).
    sure_above: confidence from which filter and re-detection learn from a frame.
    redetect: look for a hidden object over the whole frame, and prove it before it is believed.
    """

    exemplar_px: int = 127
    search_px: int = 287
    context_frac: float = 0.5
    grid_cells: int = 11
    grid_stride_px: int = 16
    penalty_k: float = 0.082
    window_influence: float = 0.42
    size_rate: float = 0.30
    cls1_weight: float = 0.8
    cls2_weight: float = 0.9
    cls2_is_logit: bool = True
    min_size_px: float = 10.0
    huge_frac: float = 0.5
    latent: LatentProvider = LatentProvider.PREVIOUS
    latent_interval: int = 1
    clip_rate: bool = False
    calibrate: bool = False
    lost_below: float = 0.0
    found_above: float = 0.0
    filter_weight: float = 0.0
    filter_share: float = 0.0
    sure_above: float = 0.6
    doubt_below: float = 0.0
    redetect: bool = False

    @property
    def has_filter(self) -> bool:
        """Whether a correlation filter is learned on line."""
        return self.filter_weight > 0 or self.filter_share > 0

    def __post_init__(self) -> None:
        _require(1 <= self.latent_interval <= 5, "latent_interval", self.latent_interval, "in 1..5")
        for field in ("penalty_k", "window_influence", "size_rate", "cls1_weight", "cls2_weight"):
            value = getattr(self, field)
            _require(0 <= value < 10, field, value, "in 0..10")
        _require(0 <= self.lost_below <= self.found_above <= 1, "lost_below", self.lost_below, "in 0..found_above..1")
        for field in ("filter_weight", "filter_share", "sure_above", "doubt_below"):
            _require(0 <= getattr(self, field) <= 1, field, getattr(self, field), "in 0..1")
        for field in ("exemplar_px", "search_px", "grid_cells", "grid_stride_px", "min_size_px"):
            _require(1 <= getattr(self, field) <= 2048, field, getattr(self, field), "in 1..2048")
        for field in ("context_frac", "huge_frac"):
            _require(0 <= getattr(self, field) <= 10, field, getattr(self, field), "in 0..10")

    def to_dict(self) -> dict[str, Any]:
        """As plain JSON values."""
        return asdict(self) | {"latent": self.latent.value}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> TrackerConfig:
        """From to_dict's values; fields left out keep their defaults; raises ConfigError on others."""
        return _from_dict(cls, values, "tracker")


def _from_dict(kind: type[T], values: Any, what: str) -> T:
    """A dataclass from JSON values of exactly its types; ConfigError."""
    try:
        unknown = set(values) - {field.name for field in fields(kind)}  # type: ignore[arg-type]
        if unknown:
            raise ConfigError(f"unknown fields: {', '.join(sorted(unknown))}")
        return msgspec.convert(values, kind, strict=True)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{what} configuration is incomplete or malformed: {error}") from error


def _sane(numbers: Iterable[float], most: float) -> bool:
    return all(math.isfinite(number) and abs(number) <= most for number in numbers)


def _require(condition: bool, field: str, value: object, wanted: str) -> None:
    if not condition:
        raise ConfigError(f"{field} = {value!r}: must be {wanted}")


# The paper's network: 42.7 M parameters, 6.4 GMAC a frame and 172 more where ClimNet draws the latent frame.
FULL = NetworkConfig(
    name="full",
    backbone_channels=(96, 256, 384, 384, 256),
    hidden=192,
    heads=6,
    ffn=2048,
    group_norm_groups=32,
    climnet=ClimNetConfig(stem=45, stages=(64, 128, 256, 512)),
    legacy_layout=True,
)

# The same network narrowed for CPUs: 3.4 M parameters, 0.74 GMAC a frame and 11.6 more with ClimNet.
COMPACT = NetworkConfig(
    name="compact",
    backbone_channels=(32, 64, 96, 96, 96),
    hidden=96,
    heads=6,
    ffn=256,
    group_norm_groups=16,
    climnet=ClimNetConfig(stem=16, stages=(16, 32, 64, 128)),
    legacy_layout=False,
    cross_attention_residual=True,
    dropout=0.0,
    input_mean=114.0,
    input_scale=1 / 58,
)

# The paper's widths with compact's layout and input: what compact weights can be widened to exactly
# (tracker.train.widen). ClimNet stays compact's.
WIDE = replace(
    COMPACT,
    name="wide",
    backbone_channels=FULL.backbone_channels,
    hidden=FULL.hidden,
    heads=FULL.heads,
    ffn=FULL.ffn,
    group_norm_groups=FULL.group_norm_groups,
)

NETWORKS = {config.name: config for config in (FULL, COMPACT, WIDE)}

"""Wide networks that start as good as a narrow trained one: function-preserving widening (Net2Wider, arXiv 1511.05641).

Every channel is copied several times, and who reads the copies splits its weight among them. The split is uneven
(at random, different for every reader), so that copies get different gradients and go separate ways; the sum stays,
and with it the function, to rounding.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from tracker.configs import NetworkConfig
from tracker.network.climrt import ClimRT
from tracker.weights import load_network

Copies = Tensor | None  # for each wide channel the narrow one it copies; None = channels that stay as they are


class WidenError(ValueError):
    """A network cannot be widened to the wanted one exactly; the message names the field."""


def widened(weights: str | Path, config: NetworkConfig, *, seed: int = 0, noise_frac: float = 0.0) -> ClimRT:
    """The network of a weights file (.safetensors) widened to a configuration. Raises WeightsError, WidenError."""
    return widen(load_network(weights), config, seed=seed, noise_frac=noise_frac)


@torch.no_grad()
def widen(narrow: ClimRT, config: NetworkConfig, *, seed: int = 0, noise_frac: float = 0.0) -> ClimRT:
    """A network of that configuration with the outputs of the narrow one, to rounding; in eval mode.

    seed: of the uneven splits. noise_frac: standard deviation of noise on every kernel and table, as a part of
    that tensor's own; 0 keeps the function. ClimNet is copied where both have the same, else drawn anew.
    Raises WidenError.
    """
    check(narrow.config, config)
    torch.manual_seed(seed)
    wide = ClimRT(config).eval()
    wide.load_state_dict(_Widening(narrow.config, config, seed).state(narrow), strict=False)
    if noise_frac:
        for parameter in [*wide.backbone.parameters(), *wide.grader.parameters()]:
            if parameter.ndim > 1:
                parameter.add_(torch.randn_like(parameter) * noise_frac * parameter.std())
    return wide


def can_widen(narrow: NetworkConfig, wide: NetworkConfig) -> bool:
    """Whether the other configuration is a wider one that a network of the first can become exactly."""
    if narrow.backbone_channels == wide.backbone_channels and narrow.hidden == wide.hidden:
        return False
    try:
        check(narrow, wide)
    except WidenError:
        return False
    return True


def check(narrow: NetworkConfig, wide: NetworkConfig) -> None:
    """Raises WidenError where a narrow network has no exact likeness in the wide configuration."""
    same = ("heads", "head_convs", "legacy_layout", "cross_attention_residual", "input_mean", "input_scale", "variant")
    for field in same:
        if getattr(narrow, field) != getattr(wide, field):
            raise WidenError(f"{field}: {getattr(narrow, field)} cannot become {getattr(wide, field)}")
    if narrow.variant.is_hift:
        raise WidenError("variant: HiFT's transformer cannot be widened")
    if narrow.legacy_layout:
        raise WidenError("legacy_layout: maps read without permuting mix channels with places")
    for field in ("hidden", "group_norm_groups"):  # a norm's mean and variance stay only with equally many copies
        if getattr(wide, field) % getattr(narrow, field):
            raise WidenError(f"{field}: {getattr(wide, field)} is no multiple of {getattr(narrow, field)}")
    if (wide.hidden // narrow.hidden) % (wide.group_norm_groups // narrow.group_norm_groups):
        raise WidenError(f"group_norm_groups: {wide.group_norm_groups} cut the copied groups into pieces")
    pairs = zip((*wide.backbone_channels, wide.ffn), (*narrow.backbone_channels, narrow.ffn), strict=True)
    if any(after < before for after, before in pairs):
        raise WidenError("backbone_channels, ffn: none may become narrower")


def spread(narrow: int, wide: int) -> Tensor:
    """Which of the narrow channels each wide one copies: neighbours alike, as evenly as it goes."""
    return torch.arange(wide) * narrow // wide  # (wide,)


def spread_groups(narrow: NetworkConfig, wide: NetworkConfig) -> Tensor:
    """As spread, for channels before a GroupNorm: each wide group holds whole copies of one narrow group."""
    size, wide_size = narrow.hidden // narrow.group_norm_groups, wide.hidden // wide.group_norm_groups
    group = spread(narrow.group_norm_groups, wide.group_norm_groups).repeat_interleave(wide_size)
    return group * size + torch.arange(wide.hidden) % wide_size % size  # (wide.hidden,)


class _Widening:
    """State dict of the wide network from the narrow one's, module by module, in the order data flows."""

    def __init__(self, narrow: NetworkConfig, wide: NetworkConfig, seed: int) -> None:
        self._narrow, self._wide = narrow, wide
        self._generator = torch.Generator().manual_seed(seed)
        self._state: dict[str, Tensor] = {}
        self._out: dict[str, Tensor] = {}

    def state(self, network: ClimRT) -> dict[str, Tensor]:
        """Wide tensors under their names."""
        self._state, self._out = network.state_dict(), {}
        same_climnet = self._narrow.climnet == self._wide.climnet
        self._out |= {k: v for k, v in self._state.items() if k.startswith("internet.") and same_climnet}
        layers = self._backbone()
        hidden = spread(self._narrow.hidden, self._wide.hidden)
        for name, channels in (("conv1", layers[3]), ("conv2", layers[4]), ("conv3", layers[4])):
            self._conv(f"grader.{name}.0", channels, hidden)
            self._per_channel(f"grader.{name}.1", hidden)
        for table in ("grader.row_embed.weight", "grader.col_embed.weight"):
            self._out[table] = self._state[table][:, spread(self._narrow.hidden // 2, self._wide.hidden // 2)]
        self._transformer(hidden)
        self._heads(hidden)
        return self._out

    def _backbone(self) -> list[Tensor]:
        channels: Copies = None  # of the picture: blue, green, red
        layers = []
        pairs = zip(self._narrow.backbone_channels, self._wide.backbone_channels, strict=True)
        for i, (before, after) in enumerate(pairs, 1):
            copies = spread(before, after)
            self._conv(f"backbone.layer{i}.0", channels, copies)
            self._per_channel(f"backbone.layer{i}.1", copies)
            layers.append(copies)
            channels = copies
        return layers

    def _transformer(self, hidden: Tensor) -> None:
        ffn = spread(self._narrow.ffn, self._wide.ffn)
        encoder, decoder = "grader.transformer.encoder", "grader.transformer.decoder"
        self._conv(f"{encoder}.layers.0.conv1.0", hidden, hidden)
        self._conv(f"{encoder}.layers.0.conv2.0", torch.cat([hidden, hidden + self._narrow.hidden]), hidden)
        for attention in (f"{encoder}.layers.0.self_attn", f"{decoder}.layers.0.self_attn"):
            self._attention(attention, hidden)
        self._attention(f"{decoder}.layers.0.multihead_attn", hidden)
        for stage, norms in ((encoder, 2), (decoder, 3)):
            self._conv(f"{stage}.layers.0.linear1", hidden, ffn)
            self._conv(f"{stage}.layers.0.linear2", ffn, hidden)
            for i in range(1, norms + 1):
                self._per_channel(f"{stage}.layers.0.norm{i}", hidden)
            self._per_channel(f"{stage}.norm", hidden)

    def _attention(self, name: str, hidden: Tensor) -> None:
        # Copied channels make every product of query and key `ratio` times as large, the wider head divides it by
        # sqrt(ratio) more: the rest is taken from the queries.
        ratio = self._wide.hidden / self._narrow.hidden
        weights = self._state[f"{name}.in_proj_weight"].chunk(3)
        biases = self._state[f"{name}.in_proj_bias"].chunk(3)
        factors = (ratio**-0.5, 1.0, 1.0)  # queries, keys, values
        projections = [self._split(w[hidden], hidden) * f for w, f in zip(weights, factors, strict=True)]
        self._out[f"{name}.in_proj_weight"] = torch.cat(projections)
        self._out[f"{name}.in_proj_bias"] = torch.cat([b[hidden] * f for b, f in zip(biases, factors, strict=True)])
        self._conv(f"{name}.out_proj", hidden, hidden)

    def _heads(self, hidden: Tensor) -> None:
        groups = spread_groups(self._narrow, self._wide)
        channels = hidden
        for i in range(self._narrow.head_convs):
            for head in ("convloc", "convcls"):
                self._conv(f"grader.{head}.{3 * i}", channels, groups)
                self._per_channel(f"grader.{head}.{3 * i + 1}", groups)
            channels = groups
        for name in (f"convloc.{3 * self._narrow.head_convs}", "cls1", "cls2"):
            self._conv(f"grader.{name}", channels, None)

    def _conv(self, name: str, inputs: Copies, outputs: Copies) -> None:
        """A convolution's or linear layer's weight, and bias if there is one."""
        for part in ("weight", "bias"):
            if (value := self._state.get(f"{name}.{part}")) is not None:
                value = value if outputs is None else value[outputs]
                self._out[f"{name}.{part}"] = self._split(value, inputs) if part == "weight" else value

    def _split(self, weight: Tensor, inputs: Copies) -> Tensor:
        """Weight (out, in, ...) with each input's share among that input's copies: positive, summing to one."""
        if inputs is None:
            return weight
        share = torch.rand(weight.shape[0], len(inputs), generator=self._generator) + 0.5  # (out, wide in)
        total = torch.zeros(weight.shape[:2]).index_add_(1, inputs, share)  # (out, in)
        share = share / total[:, inputs]
        return weight[:, inputs] * share.reshape(*share.shape, *[1] * (weight.ndim - 2))

    def _per_channel(self, name: str, channels: Tensor) -> None:
        """A norm's gains, offsets and statistics."""
        for part in ("weight", "bias", "running_mean", "running_var"):
            if (value := self._state.get(f"{name}.{part}")) is not None:
                self._out[f"{name}.{part}"] = value[channels]

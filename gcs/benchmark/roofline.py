"""Operations and bytes of each part of the network against what the machine can do at best."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from gcs.benchmark.stages_tracker import COMPARE, EMBED, IMAGINE, LESSON, RESPONSE, TEMPLATE, engines, label, measured
from gcs.benchmark.timing import Figure
from gcs.benchmark.trackers import Weights, full, shipped
from tracker.configs import TrackerConfig
from tracker.correlation_filter import REGION, FilterConfig
from tracker.engines.eager import EagerEngine
from tracker.network.cost import cost

_CLEARLY: Final = 0.5  # of the time: what explains so much of it is what binds


@dataclass(frozen=True, slots=True)
class Work:
    """Of one call. mb: weights and activations, each tensor counted where an operation reads or writes it."""

    gmac: float
    mb: float


@dataclass(frozen=True, slots=True)
class Point:
    """One stage in one engine. share: of the measured peak; bound: by what."""

    stage: str
    gmac: float
    mb: float
    ms: float
    gflops: float
    share: float
    bound: str


def points(figures: Sequence[Figure], peak_gflops: float, bandwidth_gbps: float) -> list[Point]:
    """One thread; figures: those of the stages."""
    times = {figure.name: figure.cpu_ms for figure in figures}
    return [_point(name, work, times[name], peak_gflops, bandwidth_gbps) for name, work in _works() if name in times]


def _point(stage: str, work: Work, ms: float, peak_gflops: float, bandwidth_gbps: float) -> Point:
    gflops = 2 * work.gmac / ms * 1e3
    bound = bound_by(ms, 2 * work.gmac / peak_gflops * 1e3, work.mb / bandwidth_gbps)
    return Point(stage, work.gmac, work.mb, ms, gflops, gflops / peak_gflops, bound)


def bound_by(ms: float, compute_ms: float, memory_ms: float) -> str:
    """What explains most of the time; where nothing explains half of it: overhead, of many small operations mostly."""
    most, name = max((compute_ms, "multiply-adds"), (memory_ms, "memory"))
    return name if most >= _CLEARLY * ms else "overhead"


def _works() -> Iterator[tuple[str, Work]]:
    for weights in measured():
        found = works(weights, climnet=weights != full())
        for engine in engines():
            yield from ((label(stage, weights.name, engine), work) for stage, work in found.items())
    yield from _filter_works(shipped()[0])


def works(weights: Weights, *, climnet: bool) -> Mapping[str, Work]:
    """By stage, of the network as it is made ready for flight; bytes as PyTorch moves them, others may fuse."""
    network, config = weights.network(), TrackerConfig()
    counted, engine = cost(network.config), EagerEngine(network)
    patch, template = (
        torch.zeros(1, side, side, 3, dtype=torch.uint8) for side in (config.search_px, config.exemplar_px)
    )
    features, template_features = engine.embed(patch), engine.embed(template)
    found = {
        TEMPLATE: Work(counted.template_gmac, moved_mb(lambda: engine.embed(template))),
        EMBED: Work(counted.backbone_gmac, moved_mb(lambda: engine.embed(patch))),
        COMPARE: Work(counted.heads_gmac, moved_mb(lambda: engine.compare(features, template_features, features[-1]))),
    }
    if climnet and engine.has_climnet:
        found[IMAGINE] = Work(counted.climnet_gmac, moved_mb(lambda: engine.imagine(patch, patch)))
    return found


def _filter_works(weights: Weights) -> Iterator[tuple[str, Work]]:
    """By arithmetic: the correlation filter is not part of the network."""
    config, channels = FilterConfig(), weights.network().config.backbone_channels[-2]
    cells, side = REGION**2, config.components * config.kernel**2
    reduce, apply = config.components * channels * cells, side * cells
    yield RESPONSE, Work((reduce + apply) / 1e9, 4 * (2 * channels * cells + 3 * config.components * cells) / 1e6)
    # The normal equations, then Cholesky's factor of them; the unfolded features are written, weighted and read.
    lesson = side**2 * cells + side**3 / 6
    yield LESSON, Work(lesson / 1e9, 4 * (4 * side * cells + 12 * side**2) / 1e6)


class _Bytes(TorchDispatchMode):  # type: ignore[no-untyped-call]
    """Counts what operations read and write; a view of another tensor moves nothing."""

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self.count = 0

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        result = func(*args, **(kwargs or {}))
        read = [each for each in tree_leaves((args, kwargs)) if isinstance(each, torch.Tensor)]
        written = [each for each in tree_leaves(result) if isinstance(each, torch.Tensor)]
        if not func.is_view:  # an operation in place reads and writes its own first argument
            self.count += sum(each.numel() * each.element_size() for each in (*read, *written))
        return result


def moved_mb(call: Callable[[], object]) -> float:
    """Bytes that PyTorch's operations read and write, one after the other, in units of 1e6."""
    with torch.inference_mode(False), torch.no_grad(), _Bytes() as counter:
        call()
    return float(counter.count) / 1e6

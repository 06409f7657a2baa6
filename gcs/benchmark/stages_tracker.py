"""Parts of one update of the tracker, one thread, at 720p."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import torch

from gcs.benchmark.films import BOX, frame
from gcs.benchmark.timing import Case, Repeated, use_threads
from gcs.benchmark.trackers import Weights, full, shipped
from tracker.configs import TrackerConfig
from tracker.correlation_filter import CorrelationFilter, FilterConfig
from tracker.crop import context_side_px, crop, mean_colour
from tracker.decode import decode
from tracker.engines.catalogue import ON_DEVICE, TORCH, available_engines, make_engine
from tracker.engines.engine import Engine, EngineError, Patch
from tracker.redetect import Redetector

EMBED, TEMPLATE, COMPARE, IMAGINE = "embed 287 px", "embed 127 px", "compare", "imagine (ClimNet)"
LESSON, RESPONSE = "filter lesson, every 5th frame", "filter response"


def cases(note: Callable[[str], None], *, quick: bool) -> Iterator[Case]:
    """The crop, then each engine's share, then what comes after the network. note: why an engine is left out."""
    use_threads(1)
    image, config = frame(0), TrackerConfig()
    fill = mean_colour(image)
    yield Repeated("crop 287 px, inside", lambda: crop(image, 640, 360, 220, 287, fill))
    yield Repeated("crop 287 px, at the border", lambda: crop(image, 5, 5, 220, 287, fill))
    for weights in shipped() if quick else measured():
        for name in engines():
            try:
                yield from _of_engine(weights, name, config, climnet=not quick and weights != full())
            except EngineError as error:
                note(str(error))
    yield from _of_filter(shipped()[0], config)
    random = np.random.default_rng(0)
    maps = random.uniform(0.1, 0.3, (4, 11, 11)), random.normal(size=(2, 11, 11)), random.normal(size=(1, 11, 11))
    yield Repeated("decode", lambda: decode(*maps, BOX, 1.2, (1280, 720), config))


def engines() -> list[str]:
    """On the CPU: what a GPU is asked for is not done when the call returns, and is timed by tests.gpu."""
    return [name for name in available_engines() if name not in ON_DEVICE]


def measured() -> tuple[Weights, ...]:
    """What ships, and the paper's network."""
    return tuple(dict.fromkeys((*shipped(), full())))


def label(stage: str, weights: str, engine: str) -> str:
    """Of a part of the network."""
    return f"{stage}: {weights}, {engine}"


def _of_engine(weights: Weights, name: str, config: TrackerConfig, *, climnet: bool) -> Iterator[Case]:
    engine = make_engine(name, weights.network(), 1, climnet=climnet)
    patch, template = (_patch(engine, config, side_px) for side_px in (config.search_px, config.exemplar_px))
    features, template_features = engine.embed(patch), engine.embed(template)
    titled = partial(label, weights=weights.name, engine=name)
    yield Repeated(titled(TEMPLATE), lambda: engine.embed(template))
    yield Repeated(titled(EMBED), lambda: engine.embed(patch))
    yield Repeated(titled(COMPARE), lambda: engine.compare(features, template_features, features[-1]))
    if climnet and engine.has_climnet:
        yield Repeated(titled(IMAGINE), lambda: engine.imagine(patch, patch), samples=1)


def _patch(engine: Engine, config: TrackerConfig, out_px: int) -> Patch:
    image = frame(0)
    side_px = round(context_side_px(BOX.w_px, BOX.h_px, config.context_frac) * out_px / config.exemplar_px)
    return engine.cut(image, BOX.cx_px, BOX.cy_px, side_px, out_px, mean_colour(image))


def _of_filter(weights: Weights, config: TrackerConfig) -> Iterator[Case]:
    """The correlation filter and the memory of the re-detection."""
    image, engine = frame(0), make_engine(TORCH, weights.network(), 1, climnet=False)
    features = engine.embed(_patch(engine, config, config.search_px))
    with torch.inference_mode():
        learned = CorrelationFilter(features[-2], FilterConfig())
        reduced = learned.reduce(features[-2])

    @torch.inference_mode()
    def response() -> object:
        return learned.response(learned.reduce(features[-2]))

    @torch.inference_mode()
    def lesson() -> None:
        learned.learn(reduced, (0.0, 0.0), 5)

    template = engine.embed(_patch(engine, config, config.exemplar_px))
    redetector = Redetector(engine, config, image, BOX, template)
    yield Repeated(RESPONSE, response)
    yield Repeated(LESSON, lesson)
    yield Repeated("remember, every 10th frame", lambda: redetector.remember(image, BOX))

"""Frames per second, milliseconds per stage and memory of one engine on 720p frames."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch

from tracker.box import Box
from tracker.configs import TrackerConfig
from tracker.crop import Image, mean_colour
from tracker.decode import decode
from tracker.engines.engine import Engine
from tracker.online import ClimRTTracker

WIDTH_PX, HEIGHT_PX = 1280, 720
START = Box.from_xywh(400, 300, 60, 44)
WARM_UPS = 6  # updates before the clock counts: graphs are recorded, algorithms chosen
SEARCH_SIDE_PX, TEMPLATE_SIDE_PX = 232, 103  # in the frame, of START


@dataclass(frozen=True, slots=True)
class Speed:
    """Of whole updates, wall time: frames per second over all, and ms of the middle and of the 99th of 100."""

    fps: float
    p50_ms: float
    p99_ms: float
    updates: int


def moving_thing(frames: int) -> list[Image]:
    """720p frames: a thing of many colours on a textured ground, from START on, 3 px right and 1 px down a frame."""
    rng = np.random.default_rng(5)
    ground = cv2.resize(rng.integers(40, 180, (36, 64, 3), np.uint8), (WIDTH_PX, HEIGHT_PX))
    thing = cv2.resize(rng.integers(0, 256, (6, 8, 3), np.uint8), (60, 44), interpolation=cv2.INTER_CUBIC)
    pictures = []
    for t in range(frames):
        picture = ground.copy()
        picture[300 + t : 344 + t, 400 + 3 * t : 460 + 3 * t] = thing
        pictures.append(picture)
    return pictures


def to_and_fro(frames: Sequence[Image], k: int) -> Image:
    """Frame k of the thing's way there and back, for ever."""
    last = len(frames) - 1
    return frames[last - abs(last - k % (2 * last))]


def track(engine: Engine, config: TrackerConfig, frames: Sequence[Image]) -> list[Box]:
    """Its boxes after the first frame."""
    tracker = ClimRTTracker(engine, config)
    tracker.init(frames[0], START)
    return [tracker.update(frame).box for frame in frames[1:]]


def farthest_px(a: Sequence[Box], b: Sequence[Box]) -> float:
    """Largest difference in place or size between two tracks' boxes."""
    return max(float(np.abs(np.subtract(p.xywh, q.xywh)).max()) for p, q in zip(a, b, strict=True))


def speed(engine: Engine, config: TrackerConfig, frames: Sequence[Image], seconds: float) -> Speed:
    """For about so many seconds, at least 5 updates. An update ends with maps on the CPU: nothing is left to run."""
    tracker = ClimRTTracker(engine, config)
    tracker.init(frames[0], START)
    for k in range(1, WARM_UPS + 1):
        tracker.update(to_and_fro(frames, k))
    times_ms: list[float] = []
    while len(times_ms) < 5 or sum(times_ms) < seconds * 1e3:
        frame = to_and_fro(frames, WARM_UPS + 1 + len(times_ms))
        start_s = time.perf_counter()
        tracker.update(frame)
        times_ms.append((time.perf_counter() - start_s) * 1e3)
    p50, p99 = np.percentile(times_ms, (50, 99))
    return Speed(1e3 * len(times_ms) / sum(times_ms), float(p50), float(p99), len(times_ms))


def stages_ms(
    engine: Engine, config: TrackerConfig, frames: Sequence[Image], device: torch.device, seconds: float
) -> dict[str, float]:
    """Median wall ms of each stage alone, waited for: their sum is more than an update, which waits once."""
    cx, cy, fill = START.cx_px, START.cy_px, mean_colour(frames[0])
    count = iter(range(1, 1 << 40))

    def cut(frame: Image) -> torch.Tensor:
        return engine.cut(frame, cx, cy, SEARCH_SIDE_PX, config.search_px, fill)

    template = engine.embed(engine.cut(frames[0], cx, cy, TEMPLATE_SIDE_PX, config.exemplar_px, fill))
    earlier, patch = cut(frames[0]), cut(frames[1])
    search = engine.embed(patch)
    maps = engine.compare(search, template, search[-1])
    fetched = [each[0].cpu() for each in maps]
    wh_px = (WIDTH_PX, HEIGHT_PX)
    stages: dict[str, Callable[[], object]] = {
        "upload + cut": lambda: cut(to_and_fro(frames, next(count))),
        "cut again": lambda: cut(frames[0]),
        "embed": lambda: engine.embed(patch),
        "compare": lambda: engine.compare(search, template, search[-1]),
        "fetch": lambda: [each[0].cpu() for each in maps],
        "decode": lambda: decode(*fetched, START, 1.0, wh_px, config),
    }
    if engine.has_climnet:
        stages["imagine"] = lambda: engine.imagine(earlier, patch)
    return {name: median_ms(stage, device, seconds / len(stages)) for name, stage in stages.items()}


def median_ms(stage: Callable[[], object], device: torch.device, seconds: float) -> float:
    """At least 3 runs, after one that does not count."""
    stage()
    times_ms: list[float] = []
    while len(times_ms) < 3 or sum(times_ms) < seconds * 1e3:
        wait(device)
        start_s = time.perf_counter()
        stage()
        wait(device)
        times_ms.append((time.perf_counter() - start_s) * 1e3)
    return statistics.median(times_ms)


def wait(device: torch.device) -> None:
    """Until the device has done all."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)

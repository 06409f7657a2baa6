"""`gcs bench`: what each stage costs on this machine, side by side in one run."""

from __future__ import annotations

import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from control.camera import CameraModel, bearing_measurement
from control.config import ControlConfig
from control.estimator import TargetEstimator
from control.follow import FollowState, follow_request
from control.gate import gate
from control.gate_limits import Limits
from control.modes import FollowMode, confirm
from control.types import VehicleMode, VehicleState
from tracker.box import Box
from tracker.configs import FULL, LatentProvider, TrackerConfig
from tracker.crop import crop, mean_colour
from tracker.decode import decode
from tracker.network.climrt import ClimRT
from tracker.online import ClimRTTracker
from tracker.weights import load_tracker

Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured line: median and 90th percentile of a call in ms."""

    name: str
    median_ms: float
    p90_ms: float


def measure(name: str, call: Callable[[], object], runs: int) -> Figure:
    """Wall time of `runs` calls after one to warm up."""
    call()
    times = []
    for _ in range(runs):
        began = time.perf_counter()
        call()
        times.append((time.perf_counter() - began) * 1e3)
    return Figure(name, statistics.median(times), float(np.percentile(times, 90)))


def frame(step: int, size: tuple[int, int] = (720, 1280)) -> Image:
    """A textured 720p frame with a square that moves 2 px a step."""
    rng = np.random.default_rng(1)
    small = rng.integers(0, 255, (size[0] // 8, size[1] // 8, 3), np.uint8)
    image = cv2.resize(small, (size[1], size[0]), interpolation=cv2.INTER_CUBIC)
    x = 600 + 2 * step
    cv2.rectangle(image, (x, 340), (x + 60, 390), (20, 30, 220), -1)
    return np.asarray(image, np.uint8)


BOX = Box.from_xywh(600, 340, 60, 50)


def tracker_figures(runs: int) -> list[Figure]:
    """update() of the shipped compact weights, of the full network, and of OpenCV's MIL for comparison."""
    frames = [frame(i) for i in range(8)]
    figures = []
    for threads in (1, 2):
        tracker = load_tracker("compact", threads=threads)
        figures.append(_update_figure(f"track compact, {threads} thread(s)", tracker, frames, runs))
    full = ClimRTTracker(ClimRT(FULL).eval(), TrackerConfig(latent=LatentProvider.PREVIOUS), threads=2)
    figures.append(_update_figure("track full, previous latent, 2 threads", full, frames, max(3, runs // 6)))
    mil = cv2.TrackerMIL.create()
    mil.init(frames[0], (600, 340, 60, 50))
    turn = iter(range(10**9))
    figures.append(measure("track OpenCV MIL", lambda: mil.update(frames[next(turn) % 8]), max(3, runs // 6)))
    return figures


def _update_figure(name: str, tracker: ClimRTTracker, frames: list[Image], runs: int) -> Figure:
    tracker.init(frames[0], BOX)
    turn = iter(range(10**9))
    return measure(name, lambda: tracker.update(frames[next(turn) % len(frames)]), runs)


def stage_figures(runs: int) -> list[Figure]:
    """Crop and decode, the two parts of the tracker that are not the network."""
    image, config = frame(0), TrackerConfig()
    fill = mean_colour(image)
    rng = np.random.default_rng(0)
    loc, cls1, cls2 = rng.uniform(0.1, 0.3, (4, 11, 11)), rng.normal(size=(2, 11, 11)), rng.normal(size=(1, 11, 11))
    return [
        measure("crop 287 px, inside", lambda: crop(image, 640, 360, 220, 287, fill), runs * 5),
        measure("crop 287 px, at the border", lambda: crop(image, 5, 5, 220, 287, fill), runs * 5),
        measure("decode", lambda: decode(loc, cls1, cls2, BOX, 1.2, (1280, 720), config), runs * 5),
    ]


def control_figures(runs: int) -> list[Figure]:
    """One frame of the estimator, one 20 Hz tick of law and gate."""
    config = ControlConfig()
    camera = CameraModel.from_hfov(1280, 720, math.radians(70), mount_rpy_rad=(0.0, math.radians(-25), 0.0))
    estimator = TargetEstimator(config.estimator)
    clock = iter(i * 0.05 for i in range(10**9))
    now = [0.0]

    def see() -> None:
        now[0] = next(clock)
        estimator.update(bearing_measurement(camera, 640, 360, 60, 50, (0.0, 0.0, 0.0), now[0], 1.0))

    figures = [measure("estimator, one frame", see, runs * 5)]
    t = now[0]
    vehicle = VehicleState(
        heartbeat_t_s=t, mode=VehicleMode.EXTERNAL, mode_t_s=t, armed=True, in_air=True, attitude_t_s=t, position_t_s=t,
        height_m=10.0, position_ned_m=(0.0, 0.0, -10.0),
    )  # fmt: skip
    target = estimator.predict(t)
    assert target is not None
    confirmation = confirm(FollowMode.FOLLOW, target, vehicle, t, config.follow)
    request, shape = follow_request(confirmation, target, vehicle, camera, t, FollowState.at_rest(t), config)
    limits = Limits()

    def tick() -> None:
        predicted = estimator.predict(t + 0.1)
        assert predicted is not None
        wanted, _ = follow_request(confirmation, predicted, vehicle, camera, t, shape, config)
        gate(wanted, vehicle, t, None, limits)

    return [
        *figures,
        measure("law, one tick with prediction", tick, runs * 5),
        measure("gate, one tick", lambda: gate(request, vehicle, t, None, limits), runs * 5),
    ]


def start_figure(runs: int) -> Figure:
    """`gcs --help` as a whole process."""
    command = [sys.executable, "-m", "gcs.cli", "--help"]
    return measure("gcs --help", lambda: subprocess.run(command, check=True, capture_output=True), max(3, runs // 6))


def dry_run_memory_mib() -> float:
    """Peak resident memory of a dry run over the shipped sample, MiB."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "gcs.cli", "dry-run", "--sample", "--out", str(Path(folder) / "out")]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise RuntimeError(f"gcs dry-run --sample ended with {process.returncode}")
        return usage.ru_maxrss / 1024


def run(say: Callable[[str], None], *, as_json: bool = False, runs: int = 40) -> None:
    """Measure everything and print a line each; rates and ratios are against the compact tracker."""
    figures = [*tracker_figures(runs), *stage_figures(runs), *control_figures(runs), start_figure(runs)]
    memory = dry_run_memory_mib()
    if as_json:
        say(json.dumps({"figures": {f.name: round(f.median_ms, 3) for f in figures}, "dry_run_mib": round(memory)}))
        return
    reference = figures[1].median_ms
    say(f"{'':42s}{'median':>10s}{'p90':>10s}{'per second':>12s}{'x compact':>11s}")
    for f in figures:
        times = f"{f.median_ms:8.2f} ms{f.p90_ms:7.2f} ms"
        say(f"{f.name:42s}{times}{1e3 / f.median_ms:12.1f}{f.median_ms / reference:11.3f}")
    say(f"dry run of the sample, peak resident memory: {memory:.0f} MiB")
    say(f"torch {torch.__version__}, OpenCV {cv2.__version__}, {os.cpu_count()} CPUs")

"""How long one way to track takes for a picture on this machine."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from gcs.video.frame import Image
from tracker.box import Box

_WARM, _UPDATES, _LONGEST_S = 3, 16, 1.5
_BOX: Final = Box(320.0, 180.0, 48.0, 40.0)


@dataclass(frozen=True, slots=True)
class Candidate:
    """One way to track; latent: None leaves it to the weights file.

    content: tells files of the user's own, which may change under their name, from what they were.
    """

    weights: str
    engine: str
    threads: int
    latent: str | None
    graphs: str | None = None
    content: str = ""

    def __str__(self) -> str:
        latent = "" if self.latent is None else f", latent {self.latent}"
        return f"{self.weights} on {self.engine}, {self.threads} thread{'s' if self.threads > 1 else ''}{latent}"


@dataclass(frozen=True, slots=True)
class Measured:
    """What a candidate takes for a picture here (ms), of many the lower quartile: others may be at work beside."""

    candidate: Candidate
    update_ms: float
    cpu_ms: float


def measure(candidate: Candidate) -> Measured:
    """On made-up pictures of 640x360 px, for at most about two seconds. WeightsError, EngineError, one line."""
    from tracker.configs import LatentProvider
    from tracker.weights import load_tracker

    latent = None if candidate.latent is None else LatentProvider(candidate.latent)
    tracker = load_tracker(
        candidate.weights, latent=latent, threads=candidate.threads, engine=candidate.engine, graphs=candidate.graphs
    )
    pictures = [_picture(step) for step in range(4)]
    tracker.init(pictures[0], _BOX)
    took, cpu = [], []
    end_s = time.perf_counter() + _LONGEST_S
    for step in range(_WARM + _UPDATES):
        began_s, began_cpu_s = time.perf_counter(), time.process_time()
        tracker.update(pictures[step % 4])
        took.append(1000 * (time.perf_counter() - began_s))
        cpu.append(1000 * (time.process_time() - began_cpu_s))
        if step > _WARM and time.perf_counter() > end_s:
            break
    return Measured(candidate, float(np.percentile(took[_WARM:], 25)), float(np.percentile(cpu[_WARM:], 25)))


def _picture(step: int) -> Image:
    """A square that moves over a texture."""
    rough = np.random.default_rng(1).integers(0, 255, (45, 80, 3), np.uint8)
    picture = np.asarray(cv2.resize(rough, (640, 360), interpolation=cv2.INTER_CUBIC), np.uint8)
    x, y, w, h = (round(v) for v in _BOX.xywh)
    cv2.rectangle(picture, (x + 2 * step, y), (x + 2 * step + w, y + h), (20, 30, 220), -1)
    return picture

"""Run a tracker through one sequence: one pass, the first box given, the rest its own."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tracker.box import Box, TrackResult
from tracker.configs import LatentProvider
from tracker.crop import Image
from tracker.eval.latency import LatencyConfig, LateOutcome, track_late
from tracker.eval.ope import Score, score
from tracker.eval.sequences import Sequence
from tracker.eval.starts import EXACT, Start


class Tracker(Protocol):
    """What is evaluated: ClimRTTracker, or anything else of its form."""

    def init(self, frame_bgr: Image, box: Box) -> None: ...

    def update(self, frame_bgr: Image) -> TrackResult: ...


@dataclass(frozen=True, slots=True)
class Outcome:
    """One sequence's boxes (N,4) x,y,w,h px, score, frames a second of tracking alone, seconds per frame (N,)."""

    name: str
    boxes_xywh: NDArray[np.float64]
    score: Score
    fps: float
    times_s: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    late: LateOutcome | None = None


@dataclass(frozen=True, slots=True)
class Shipped:
    """Makes trackers from weights: a name that ships, or a .safetensors file. Travels to other processes.

    engine, threads: what runs them; latent: provider of the latent frame, None: the weights' own.
    graphs: folder of those exported from the weights, to be run instead.
    """

    weights: str
    engine: str = "torch"
    threads: int | None = None
    latent: LatentProvider | None = None
    graphs: str | None = None

    def __call__(self) -> Tracker:
        from tracker.weights import load_tracker  # here: who only scores boxes waits for no PyTorch

        return load_tracker(
            self.weights, engine=self.engine, threads=self.threads, latent=self.latent, graphs=self.graphs
        )


@dataclass(frozen=True, slots=True)
class Job:
    """How each sequence is run.

    threads: CPU threads for PyTorch, None leaves them. latency: score that too, from the true first box. start: what
    is done to the first box.
    """

    make_tracker: Callable[[], Tracker]
    threads: int | None = None
    latency: LatencyConfig | None = None
    start: Start = EXACT

    def run(self, sequence: Sequence, on_frame: Callable[[], object] | None = None) -> Outcome:
        """One sequence with a tracker of its own, so that none can carry over to the next."""
        if self.threads is not None:
            import torch

            torch.set_num_threads(self.threads)
        outcome = run_sequence(self.make_tracker(), sequence, on_frame, self.start)
        if self.latency is None:
            return outcome
        late = track_late(self.make_tracker, sequence, outcome.boxes_xywh, outcome.times_s, self.latency)
        return Outcome(outcome.name, outcome.boxes_xywh, outcome.score, outcome.fps, outcome.times_s, late)


def run_sequence(
    tracker: Tracker, sequence: Sequence, on_frame: Callable[[], object] | None = None, start: Start = EXACT
) -> Outcome:
    """One pass: the first box is given, the rest is the tracker's own. on_frame is called after each frame."""
    boxes: list[tuple[float, float, float, float]] = []
    times_s: list[float] = []
    for i, image in enumerate(sequence.images()):
        began = time.perf_counter()
        if i == 0:
            first = start.of(Box.from_xywh(*(float(v) for v in sequence.truth_xywh[0])))
            tracker.init(image, first)
            boxes.append(first.xywh)
        else:
            boxes.append(tracker.update(image).box.xywh)
        times_s.append(time.perf_counter() - began)
        if on_frame is not None:
            on_frame()
    result = np.array(boxes)
    fps = (len(boxes) - 1) / max(sum(times_s[1:]), 1e-9)
    return Outcome(sequence.name, result, score(result, sequence.truth_xywh), fps, np.array(times_s))

"""Run a tracker through sequences and score it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tracker.box import Box
from tracker.eval.ope import Score, mean_score, score
from tracker.eval.sequences import Sequence, load_dataset
from tracker.online import ClimRTTracker
from tracker.weights import load_tracker


@dataclass(frozen=True, slots=True)
class Outcome:
    """One sequence's boxes (N,4) x,y,w,h px, score, and frames a second of tracking alone."""

    name: str
    boxes_xywh: NDArray[np.float64]
    score: Score
    fps: float


def run_sequence(tracker: ClimRTTracker, sequence: Sequence) -> Outcome:
    """One pass: the first box is given, the rest is the tracker's own."""
    boxes = []
    spent_s = 0.0
    for i, image in enumerate(sequence.images()):
        if i == len(sequence.truth_xywh):
            break
        began = time.perf_counter()
        if i == 0:
            tracker.init(image, Box.from_xywh(*(float(v) for v in sequence.truth_xywh[0])))
            boxes.append(tuple(sequence.truth_xywh[0]))
        else:
            boxes.append(tracker.update(image).box.xywh)
            spent_s += time.perf_counter() - began
    result = np.array(boxes)
    truth = sequence.truth_xywh[: len(result)]
    return Outcome(sequence.name, result, score(result, truth), (len(boxes) - 1) / max(spent_s, 1e-9))


def bench(
    dataset: Path, weights: str, say: Callable[[str], None], *, as_json: bool = False, results: Path | None = None
) -> Score:
    """Score the weights on every sequence of a folder; a line each, then the mean.

    results: folder for the boxes as text, one file per sequence, x,y,w,h per line.
    """
    tracker = load_tracker(weights)
    outcomes: list[Outcome] = []
    for sequence in load_dataset(dataset):
        outcome = run_sequence(tracker, sequence)
        outcomes.append(outcome)
        say(_line(outcome.name, outcome.score, outcome.fps, as_json))
        if results is not None:
            results.mkdir(parents=True, exist_ok=True)
            np.savetxt(results / f"{outcome.name}.txt", outcome.boxes_xywh, fmt="%.2f", delimiter=",")
    mean = mean_score(o.score for o in outcomes)
    say(_line("mean", mean, float(np.mean([o.fps for o in outcomes])), as_json))
    return mean


def _line(name: str, value: Score, fps: float, as_json: bool) -> str:
    if as_json:
        figures = {k: round(v, 4) for k, v in asdict(value).items()}
        return json.dumps({"sequence": name, **figures, "fps": round(fps, 1)})
    return f"{name:14s} auc {value.auc:.3f}  precision {value.precision:.3f}  {fps:6.1f} fps"

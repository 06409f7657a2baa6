"""Scores as lines: for people a table, for programs one JSON object each."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np

from tracker.eval.attributes import NAMES, by_attribute
from tracker.eval.benchmark import Results
from tracker.eval.ope import Score, mean_score
from tracker.eval.run import Outcome
from tracker.eval.sequences import Sequence

HEADER = f"{'sequence':24s}   auc  prec  | valid frames only    fps"
LATE_HEADER = "latency-aware        auc  prec"


def outcome_line(outcome: Outcome, *, as_json: bool, tracker: str | None = None) -> str:
    """One sequence. tracker: named in JSON where there are several."""
    if as_json:
        row = {"tracker": tracker} if tracker else {}
        return json.dumps(row | {"sequence": outcome.name} | _figures([outcome]))
    return _row(outcome.name, outcome.score, outcome.fps)


def mean_line(results: Results, *, as_json: bool, named: bool = False) -> str:
    """The mean over sequences. named: the tracker's name stands for it where there are several."""
    if as_json:
        row = {"tracker": results.tracker} if named else {}
        figures = _figures(list(results.outcomes)) | {"sequences": len(results.outcomes)}
        return json.dumps(row | {"sequence": "mean"} | figures)
    count = len(results.outcomes)
    label = f"{results.tracker} ({count})" if named else f"mean ({count})"
    return _row(label, mean_score(o.score for o in results.outcomes), _mean_fps(results.outcomes))


def late_lines(results: Results) -> Iterator[str]:
    """Offline against latency-aware, without and with prediction, as a table; nothing where it was not asked for."""
    late = [o.late for o in results.outcomes if o.late is not None]
    if not late:
        return
    yield LATE_HEADER
    rows = {
        "offline": mean_score(o.score for o in results.outcomes),
        "latest answer": mean_score(each.score for each in late),
        "predicted": mean_score(each.predicted_score for each in late),
    }
    for label, value in rows.items():
        yield f"  {label:16s} {value.auc:6.3f} {value.precision:5.3f}"
    rates = sorted({each.fps for each in late})
    clock = " to ".join(f"{rate:g}" for rate in (rates[:1] if len(rates) == 1 else (rates[0], rates[-1])))
    yield f"  frames skipped {100 * np.mean([each.skipped for each in late]):.1f} % (frames arrive at {clock} fps)"


def start_line(start: str, results: Results, *, as_json: bool) -> str:
    """The mean over sequences from one kind of first box."""
    if as_json:
        return json.dumps({"start": start} | _figures(list(results.outcomes)) | {"sequences": len(results.outcomes)})
    return _row(start, mean_score(o.score for o in results.outcomes), _mean_fps(results.outcomes))


def starts_lines(passes: list[Results], *, as_json: bool) -> Iterator[str]:
    """The mean over all first boxes, and how far they lie apart."""
    means = [mean_score(o.score for o in each.outcomes) for each in passes]
    deviation = {key: round(float(np.std([asdict(mean)[key] for mean in means])), 4) for key in asdict(means[0])}
    if as_json:
        yield json.dumps({"start": "mean", "starts": len(means)} | _rounded(mean_score(means)) | {"std": deviation})
        return
    yield _row(f"mean ({len(means)} starts)", mean_score(means), float("nan"))
    yield "standard deviation       " + "{auc:.4f} {precision:.4f} | {auc_valid:.4f} {precision_valid:.4f}".format(
        **deviation
    )


def attribute_lines(sequences: tuple[Sequence, ...], trackers: list[Results], *, as_json: bool) -> Iterator[str]:
    """Precision and success of the sequences with each attribute, a column per tracker."""
    table = by_attribute(sequences)
    if not table:
        if not as_json:
            yield "attributes: this data set has none on disk"
        return
    width = max(14, *(len(r.tracker) + 1 for r in trackers))
    if not as_json:
        head = "".join(f"{r.tracker:>{width}s}" for r in trackers)
        yield f"{'precision / success by attribute':36s}{head}"
    for short, names in table.items():
        scores = {r.tracker: _mean_of(r, names) for r in trackers}
        if as_json:
            for tracker, value in scores.items():
                if value is not None:
                    row = {"attribute": short, "tracker": tracker, "sequences": len(names)}
                    yield json.dumps(row | _rounded(value))
            continue
        cells = (f"{v.precision:.3f} / {v.auc:.3f}" if v is not None else "-" for v in scores.values())
        label = f"{short:4s} {NAMES.get(short, '')} ({len(names)})"
        yield f"{label:36s}" + "".join(f"{cell:>{width}s}" for cell in cells)


def _mean_of(results: Results, names: tuple[str, ...]) -> Score | None:
    scores = [o.score for o in results.outcomes if o.name in names]
    return mean_score(scores) if scores else None


def _figures(outcomes: list[Outcome]) -> dict[str, Any]:
    fps = _mean_fps(outcomes)
    figures = _rounded(mean_score(o.score for o in outcomes)) | {"fps": None if np.isnan(fps) else round(fps, 1)}
    late = [o.late for o in outcomes if o.late is not None]
    if late:
        plain, predicted = mean_score(each.score for each in late), mean_score(each.predicted_score for each in late)
        figures |= {"auc_late": round(plain.auc, 4), "precision_late": round(plain.precision, 4)}
        figures |= {"auc_predicted": round(predicted.auc, 4), "precision_predicted": round(predicted.precision, 4)}
        figures["skipped"] = round(float(np.mean([each.skipped for each in late])), 4)
    return figures


def _rounded(value: Score) -> dict[str, float]:
    return {key: round(each, 4) for key, each in asdict(value).items()}


def _mean_fps(outcomes: list[Outcome] | tuple[Outcome, ...]) -> float:
    known = [o.fps for o in outcomes if not np.isnan(o.fps)]
    return float(np.mean(known)) if known else float("nan")


def _row(label: str, value: Score, fps: float) -> str:
    speed = "" if np.isnan(fps) else f"{fps:7.1f}"
    return (
        f"{label:24s} {value.auc:.4f} {value.precision:.4f} | {value.auc_valid:.4f} {value.precision_valid:.4f} {speed}"
    ).rstrip()

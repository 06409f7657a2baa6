"""Success, precision and centre-error figures as PNG. The caller needs no display."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tracker.eval.attributes import NAMES, by_attribute
from tracker.eval.benchmark import Results
from tracker.eval.ope import (
    PRECISION_PX,
    PRECISION_THRESHOLDS_PX,
    SUCCESS_THRESHOLDS,
    Curves,
    centre_errors_px,
    curves,
    mean_curves,
    prepared,
)
from tracker.eval.sequences import Sequence

SIZE_IN = (6.0, 4.5)
TOP_CLE_PX = 200.0  # a lost target's error says nothing by its size


def plot_all(
    folder: Path, title: str, sequences: tuple[Sequence, ...], trackers: list[Results], *, attributes: bool
) -> Iterator[Path]:
    """Success and precision over all sequences (attributes: and of each), centre error of each; paths as written."""
    folder.mkdir(parents=True, exist_ok=True)
    groups: dict[str, tuple[str, ...]] = {"": tuple(s.name for s in sequences)}
    if attributes:
        groups |= by_attribute(sequences)
    for short, names in groups.items():
        each = {r.tracker: c for r in trackers if (c := _curves(r, sequences, names)) is not None}
        heading = f"{title}, {NAMES.get(short, short)} ({len(names)})" if short else f"{title} ({len(names)})"
        ending = f"_{short}" if short else ""
        for kind, draw in (("success", _draw_success), ("precision", _draw_precision)):
            path = folder / f"{kind}{ending}.png"
            _figure(path, heading, each, draw)
            yield path
    for sequence in sequences:
        boxes = {r.tracker: o.boxes_xywh for r in trackers for o in r.outcomes if o.name == sequence.name}
        if boxes:
            path = folder / f"cle_{sequence.name}.png"
            plot_centre_error(path, sequence, boxes)
            yield path


def plot_centre_error(path: Path, sequence: Sequence, boxes_xywh: dict[str, NDArray[np.float64]]) -> None:
    """Centre location error over time, as the paper's real-world figure; boxes (N,4) by tracker, the first is ours.

    Shaded red where ours is lost (further off than the 20 px line), grey where the target is absent.
    """
    figure = Figure(figsize=(8.0, 3.0), layout="constrained")
    axes = figure.add_subplot()
    time_s = np.arange(len(sequence)) / sequence.fps
    for at, (name, boxes) in enumerate(boxes_xywh.items()):
        errors = centre_errors_px(*prepared(boxes, sequence.truth_xywh))
        absent = errors < 0
        errors = np.where(absent, np.nan, errors)
        axes.plot(time_s, errors, label=name, linewidth=1.4 if at == 0 else 0.9, zorder=3 if at == 0 else 2)
        if at == 0:
            _shade(axes, time_s, absent, "0.8", "target absent")
            _shade(axes, time_s, errors > PRECISION_PX, "mistyrose", f"{name} lost")
    axes.axhline(PRECISION_PX, color="black", linestyle="--", linewidth=0.8, label=f"{PRECISION_PX:g} px")
    axes.set(xlabel="time, s", ylabel="centre location error, px", title=sequence.name, ylim=(0, TOP_CLE_PX))
    axes.set_xlim(0, max(float(time_s[-1]), 1e-3))
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small")
    _save(figure, path)


def _curves(results: Results, sequences: tuple[Sequence, ...], names: tuple[str, ...]) -> Curves | None:
    truths = {s.name: s.truth_xywh for s in sequences if s.name in names}
    each = [curves(o.boxes_xywh, truths[o.name]) for o in results.outcomes if o.name in truths]
    return mean_curves(each) if each else None


def _figure(path: Path, title: str, each: dict[str, Curves], draw: Any) -> None:
    figure = Figure(figsize=SIZE_IN, layout="constrained")
    axes = figure.add_subplot()
    draw(axes, each)
    axes.set(title=title, ylim=(0, 1))
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")
    _save(figure, path)


def _draw_success(axes: Any, each: dict[str, Curves]) -> None:
    for name, curve in sorted(each.items(), key=lambda item: -item[1].success.mean()):
        axes.plot(SUCCESS_THRESHOLDS, curve.success, label=f"{name} [{curve.success.mean():.3f}]")
    axes.set(xlabel="overlap threshold", ylabel="success rate", xlim=(0, 1))


def _draw_precision(axes: Any, each: dict[str, Curves]) -> None:
    at = int(PRECISION_PX)
    for name, curve in sorted(each.items(), key=lambda item: -item[1].precision[at]):
        axes.plot(PRECISION_THRESHOLDS_PX, curve.precision, label=f"{name} [{curve.precision[at]:.3f}]")
    axes.axvline(PRECISION_PX, color="black", linestyle="--", linewidth=0.8)
    axes.set(xlabel="centre location error threshold, px", ylabel="precision", xlim=(0, 50))


def _shade(axes: Any, time_s: NDArray[np.float64], where: NDArray[np.bool_], colour: str, label: str) -> None:
    if where.any():
        axes.fill_between(time_s, 0, TOP_CLE_PX, where=where, color=colour, linewidth=0, step="mid", label=label)


def _save(figure: Figure, path: Path) -> None:
    figure.savefig(path, dpi=110)

"""A run's log as one picture: losses, held-out figures, learning rate and speed over the samples seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

Row = dict[str, Any]
Line = tuple[np.ndarray, np.ndarray]  # samples, values

VALIDATION = "validation"
NOT_FIGURES = ("time", "stage", "samples")
SPEEDS = ("samples_per_s", "samples_s", "speed")
# Of the loop's entries neither loss nor figure of merit: they stay in the log.
UNDRAWN = ("step", "progress", "minutes_left", "score")
STAGE_COLOURS = ("#dfe8f5", "#f7ead9", "#e3f1e1", "#f2e1ee")
SMOOTHING = 0.03  # of a stage's entries: the width of the running mean


@dataclass(frozen=True, slots=True)
class Panel:
    """One set of axes: its title and which figure of which stage belongs there."""

    title: str
    holds: Callable[[str, str], bool]
    logarithmic: bool = False
    from_zero_to_one: bool = False


def _is_share(name: str) -> bool:
    return name.startswith(("wait", "gpu_busy")) or name.endswith("waiting")


def _is_loss(stage: str, name: str) -> bool:
    known = (*SPEEDS, "lr", *UNDRAWN)
    return stage != VALIDATION and name not in known and not name.endswith("_db") and not _is_share(name)


PANELS = (
    Panel("losses", _is_loss, logarithmic=True),
    Panel(
        "held-out pictures",
        lambda stage, name: stage == VALIDATION and not name.endswith("_db") and name not in UNDRAWN,
        from_zero_to_one=True,
    ),
    Panel("latent frame, PSNR [dB]", lambda _stage, name: name.endswith("_db")),
    Panel("learning rate", lambda stage, name: stage != VALIDATION and name == "lr", logarithmic=True),
    Panel("samples per second", lambda _stage, name: name in SPEEDS),
)


def draw_curves(rows: Sequence[Row], path: Path) -> Path:
    """Draw the rows of a log.csv (tracker.train.journal.read_log) as PNG; panels without figures are left out."""
    rows = [row for row in rows if "samples" in row]
    filled = [(panel, lines) for panel in PANELS if (lines := lines_of(rows, panel))]
    height = max(1, len(filled))
    figure = Figure(figsize=(10, 1.2 + 2.3 * height), layout="constrained")
    if not filled:
        figure.text(0.5, 0.5, "nothing logged yet", ha="center", va="center")
    axes = figure.subplots(height, 1, sharex=True, squeeze=False)[:, 0] if filled else []
    for axis, (panel, lines) in zip(axes, filled, strict=True):
        _shade_stages(axis, rows, named=axis is axes[0])
        _draw_panel(axis, panel, lines)
    if filled:
        axes[-1].set_xlabel("samples seen")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    return path


def lines_of(rows: Sequence[Row], panel: Panel) -> dict[str, list[Line]]:
    """Label to its pieces, one piece per uninterrupted stage, of what the panel shows."""
    found: dict[str, list[Line]] = {}
    for held_out in (False, True):
        chosen = [row for row in rows if (row["stage"] == VALIDATION) == held_out]
        for stage, group in groupby(chosen, key=lambda row: row["stage"]):
            piece = list(group)
            names = dict.fromkeys(name for row in piece for name in row if name not in NOT_FIGURES)
            for name in names:
                if panel.holds(stage, name):
                    pairs = [(row["samples"], row[name]) for row in piece if name in row]
                    label = f"{name} (held out)" if held_out and name.endswith("_db") else name
                    samples, values = np.array(pairs, float).T
                    found.setdefault(label, []).append((samples, values))
    return found


def smoothed(values: np.ndarray) -> np.ndarray:
    """Running mean over a few per cent of the curve, shorter towards its ends; ignores what is not finite."""
    half = max(1, round(len(values) * SMOOTHING))
    good = np.isfinite(values)
    total = np.concatenate([[0], np.cumsum(np.where(good, values, 0))])
    count = np.concatenate([[0], np.cumsum(good)])
    index = np.arange(len(values))
    low, high = np.maximum(index - half, 0), np.minimum(index + half + 1, len(values))
    return np.where(
        count[high] > count[low], (total[high] - total[low]) / np.maximum(count[high] - count[low], 1), np.nan
    )


def _draw_panel(axis: Axes, panel: Panel, lines: dict[str, list[Line]]) -> None:
    for i, (label, pieces) in enumerate(lines.items()):
        colour = f"C{i % 10}"
        for k, (samples, values) in enumerate(pieces):
            name = label if k == 0 else None
            if len(values) < 20:
                axis.plot(samples, values, "o-", ms=3, color=colour, label=name)
            else:
                axis.plot(samples, values, color=colour, lw=0.6, alpha=0.25)
                axis.plot(samples, smoothed(values), color=colour, lw=1.6, label=name)
    everything = np.concatenate([values for pieces in lines.values() for _, values in pieces])
    if panel.logarithmic and (everything[np.isfinite(everything)] > 0).all():
        axis.set_yscale("log")
    if panel.from_zero_to_one and np.nanmax(everything) <= 1 and np.nanmin(everything) >= 0:
        axis.set_ylim(0, 1)
    axis.set_title(panel.title, loc="left", fontsize=10)
    axis.grid(alpha=0.3)
    axis.spines[["top", "right"]].set_visible(False)
    axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, frameon=False)


def _shade_stages(axis: Axes, rows: Sequence[Row], named: bool) -> None:
    training = [row for row in rows if row["stage"] != VALIDATION]
    begin = 0.0
    for i, (stage, group) in enumerate(groupby(training, key=lambda row: row["stage"])):
        end = max(row["samples"] for row in group)
        axis.axvspan(begin, end, color=STAGE_COLOURS[i % len(STAGE_COLOURS)], lw=0)
        if named:
            at = (begin + end) / 2
            axis.annotate(stage, (at, 0.97), xycoords=("data", "axes fraction"), ha="center", va="top", fontsize=9)
        begin = end

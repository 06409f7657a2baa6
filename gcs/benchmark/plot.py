"""The same as a picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from gcs.benchmark.results import Group, Results

_OURS, _OTHERS = "tab:blue", "0.6"
_REST = "beside the network"


def plot(path: Path, results: Results) -> None:
    """Write a PNG of what was measured; nothing where nothing was."""
    # Here, because importing it takes a second.
    from matplotlib.figure import Figure

    panels: list[Callable[[Any], None]] = []
    if results.trackers:
        panels.append(lambda axes: _trackers(axes, results.trackers[0]))
    if results.roofline:
        panels.append(lambda axes: _roofline(axes, results))
    if results.ages:
        panels.append(lambda axes: _ages(axes, results))
    if results.growth:
        panels.append(lambda axes: _growth(axes, results))
    if not panels:
        return
    columns = min(2, len(panels))
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(7 * columns, 4.5 * rows), dpi=100, layout="constrained")
    figure.suptitle(str(results.machine.facts.get("cpu", "")))
    for number, draw in enumerate(panels):
        axes = figure.add_subplot(rows, columns, number + 1)
        draw(axes)
        axes.grid(alpha=0.3)
    figure.savefig(path)


def _trackers(axes: Any, group: Group) -> None:
    figures = sorted(group.figures, key=lambda figure: -figure.cost_ms)
    names = [figure.name for figure in figures]
    colours = [_OTHERS if name.startswith("OpenCV") else _OURS for name in names]
    bars = axes.barh(names, [figure.cost_ms for figure in figures], color=colours)
    axes.bar_label(bars, [f" {figure.cost_ms:.1f}" for figure in figures], fontsize="small")
    axes.set(xscale="log", xlabel="CPU ms a picture (mean)", title=group.title)
    axes.margins(x=0.15)


def _roofline(axes: Any, results: Results) -> None:
    peak, bandwidth = results.machine.peak_gflops[1], results.machine.bandwidth_gbps or 1.0
    intensity = [2e3 * point.gmac / point.mb for point in results.roofline]
    ridge = peak / bandwidth
    low, high = min(ridge, *intensity) / 2, max(ridge, *intensity) * 2
    axes.plot([low, ridge, high], [low * bandwidth, peak, peak], color="black")
    engines: dict[str, list[tuple[float, float]]] = {}
    lowest: dict[str, tuple[float, float]] = {}
    for point, x in zip(results.roofline, intensity, strict=True):
        stage, _, engine = point.stage.rpartition(", ")
        engines.setdefault(engine if ": " in stage else _REST, []).append((x, point.gflops))
        name = stage if ": " in stage else point.stage
        lowest[name] = (x, min(point.gflops, lowest.get(name, (x, peak))[1]))
    for engine, places in engines.items():
        axes.plot(*zip(*places, strict=True), "o", label=engine, alpha=0.8)
    for name, place in lowest.items():
        axes.annotate(
            name, place, (0, -6), textcoords="offset points", fontsize="x-small", rotation=90, ha="center", va="top"
        )
    axes.margins(y=0.2)
    axes.legend(fontsize="small", loc="lower right")
    axes.set(xscale="log", yscale="log", xlabel="FLOP a byte moved", ylabel="GFLOP/s, one thread", title="roofline")


def _ages(axes: Any, results: Results) -> None:
    _bars(axes, [age.name for age in results.ages], {
        "p50": [age.setpoint.p50 for age in results.ages],
        "p99": [age.setpoint.p99 for age in results.ages],
        "answer p50": [age.answer.p50 for age in results.ages],
        "answer p99": [age.answer.p99 for age in results.ages],
    })  # fmt: skip
    axes.axhline(60, color="tab:red", linewidth=0.8)
    axes.set(ylabel="ms", title="age of the picture at the setpoint")


def _growth(axes: Any, results: Results) -> None:
    names, bottom = [size.name for size in results.growth], [0.0] * len(results.growth)
    for part in results.growth[0].parts:
        values = [size.parts[part] for size in results.growth]
        axes.bar(names, values, bottom=bottom, label=part)
        bottom = [below + value for below, value in zip(bottom, values, strict=True)]
    axes.set(ylabel="CPU ms", title="a tracked, shown picture")
    axes.legend(fontsize="small")


def _bars(axes: Any, names: Sequence[str], series: dict[str, list[float]]) -> None:
    width = 0.8 / len(series)
    for number, (label, values) in enumerate(series.items()):
        axes.bar([i + number * width for i in range(len(names))], values, width, label=label)
    axes.set_xticks([i + 0.4 - width / 2 for i in range(len(names))], names, fontsize="x-small")
    axes.legend(fontsize="small")

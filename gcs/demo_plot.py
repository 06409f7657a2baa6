"""The flight as a picture: paths from above, and both errors over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gcs.demo_report import Span, TruthRow


def plot(path: Path, truth: Sequence[TruthRow], spans: Sequence[Span], title: str) -> None:
    """Write a PNG; gaps in following stay white in the error plots."""
    # Here, because importing pyplot takes a second that no flight should wait for.
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 6), dpi=100, layout="constrained")
    above, bearing, distance = figure.subplot_mosaic([["above", "bearing"], ["above", "distance"]]).values()
    figure.suptitle(title)
    draw_from_above(above, truth, spans)
    draw_errors(bearing, distance, truth, spans)
    figure.savefig(path)


def draw_from_above(axes: Any, truth: Sequence[TruthRow], spans: Sequence[Span]) -> None:
    """Paths from above, lines of sight while following."""
    axes.plot([r.target_ned_m[1] for r in truth], [r.target_ned_m[0] for r in truth], color="tab:red", label="target")
    axes.plot([r.vehicle_ned_m[1] for r in truth], [r.vehicle_ned_m[0] for r in truth], color="0.6", label="vehicle")
    for number, span in enumerate(spans):
        rows = [r for r in truth if span.start_s <= r.t_s <= span.end_s]
        east, north = [r.vehicle_ned_m[1] for r in rows], [r.vehicle_ned_m[0] for r in rows]
        axes.plot(east, north, color="tab:blue", linewidth=2, label="vehicle, following" if number == 0 else None)
        for row in rows[::60]:  # lines of sight, so that it shows who looked where and when
            axes.plot(
                [row.vehicle_ned_m[1], row.target_ned_m[1]],
                [row.vehicle_ned_m[0], row.target_ned_m[0]],
                color="0.8",
                linewidth=0.6,
                zorder=0,
            )
    hidden = [r for r in truth if not r.is_visible and any(s.start_s <= r.t_s <= s.end_s for s in spans)]
    if hidden:
        axes.scatter(
            [r.target_ned_m[1] for r in hidden], [r.target_ned_m[0] for r in hidden], color="black", s=12,
            label="target hidden", zorder=3,
        )  # fmt: skip
    axes.set(xlabel="east (m)", ylabel="north (m)")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.3)
    axes.legend(loc="best", fontsize="small")


def draw_errors(bearing: Any, distance: Any, truth: Sequence[TruthRow], spans: Sequence[Span]) -> None:
    """Both errors over the time since the first confirmation."""
    start_s = spans[0].start_s if spans else 0.0
    for span in spans:
        rows = [r for r in truth if span.start_s <= r.t_s <= span.end_s]
        times = [r.t_s - start_s for r in rows]
        bearing.plot(times, [math.degrees(r.bearing_error_rad) for r in rows], color="tab:blue")
        distance.plot(times, [100 * (r.distance_m / span.standoff_m - 1) for r in rows], color="tab:blue")
    bearing.set(ylabel="bearing error (deg)")
    distance.set(ylabel="distance error (% of standoff)", xlabel="time since the confirmation (s)")
    for axes in (bearing, distance):
        axes.axhline(0.0, color="0.5", linewidth=0.8)
        axes.grid(alpha=0.3)

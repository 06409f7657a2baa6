"""A flight as a picture: paths from above, both errors, and what was commanded."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gcs.demo_plot import draw_errors, draw_from_above
from gcs.demo_report import Span, TruthRow
from gcs.scenarios.measure import Row, Sample


def plot(path: Path, samples: Sequence[Sample], row: Row, title: str) -> None:
    """Write a PNG."""
    # Here, because importing it takes a second that no flight should wait for.
    from matplotlib.figure import Figure

    truth = [TruthRow(s.t_s, s.vehicle_ned_m, s.yaw_rad, s.target_ned_m, _BOX, float(s.is_visible)) for s in samples]
    spans = [Span(samples[0].t_s, samples[-1].t_s, samples[0].distance_m)]
    figure = Figure(figsize=(12, 8), dpi=80, layout="constrained")
    parts: dict[str, Any] = figure.subplot_mosaic(
        [["above", "bearing"], ["above", "distance"], ["above", "speed"], ["above", "yaw"]]
    )
    figure.suptitle(f"{title}\n{row.bearing_rms_deg:.2f} deg rms, {row.state.value}", fontsize="medium")
    draw_from_above(parts["above"], truth, spans)
    draw_errors(parts["bearing"], parts["distance"], truth, spans)
    times = [s.t_s for s in samples]
    for number, name in enumerate(("north", "east", "down")):
        parts["speed"].plot(times, [s.velocity_ned_mps[number] for s in samples], label=name, linewidth=0.9)
    parts["speed"].legend(loc="upper right", fontsize="small", ncols=3)
    parts["speed"].set(ylabel="commanded (m/s)")
    parts["yaw"].plot(times, [math.degrees(s.yaw_rate_rps) for s in samples], color="tab:green", linewidth=0.9)
    parts["yaw"].set(ylabel="commanded (deg/s)", xlabel="time since the confirmation (s)")
    for name in ("speed", "yaw"):
        parts[name].grid(alpha=0.3)
    figure.savefig(path)


_BOX = (0.0, 0.0, 1.0, 1.0)  # only its visibility is drawn

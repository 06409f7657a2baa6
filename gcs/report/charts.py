"""Which curves the page shows, with which limits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from control.camera import ray_camera
from gcs.config import Config
from gcs.errors import ConfigError
from gcs.report.above import from_above, is_in_sight
from gcs.report.figures import Report
from gcs.report.histogram import histogram
from gcs.report.html import Html, figure, legend, note, table
from gcs.report.pictures import key_of
from gcs.report.svg import Level, Line, Shade, TimeChart, number
from gcs.report.tally import Tally
from gcs.report.tally_time import PARTS
from gcs.report.words import clock

_PARTS_SAID: Final = {
    "glass": "light to the picture's arrival", "decode": "to the decoded picture", "wait": "until the tracker took it",
    "track": "the tracker", "control": "to the setpoint", "link": "to the vehicle",
}  # fmt: skip


def curves(report: Report, tally: Tally, config: Config | None) -> Html:
    """All over the same time; where the target was followed is shaded, where it was lost shaded red."""
    drawn = "".join(_drawn(chart) for chart in _charts(report, tally, config))
    if not drawn:
        return Html("")
    said = "Green: a target was followed. Red: it was not seen. A click there leads to what happened."
    return Html(note(said if report.follows else "") + f'<div class="grid2">{drawn}</div>')


def _charts(report: Report, tally: Tally, config: Config | None) -> Iterator[TimeChart]:
    span_s, shades, follow = report.lasted_s, shades_of(report), tally.follow
    control = None if config is None else config.control

    def chart(title: str, unit: str, *lines: Line, levels: tuple[Level, ...] = (), zero: bool = False) -> TimeChart:
        return TimeChart(title, unit, lines, span_s, levels, shades, zero)

    nearest = () if control is None else (Level("nearest", control.follow.min_distance_m),)
    yield chart(
        "Distance to the target, m", "m", Line("distance", follow.distance_m), Line("standoff", follow.standoff_m, "b"),
        levels=nearest,
    )  # fmt: skip
    middle = (Level("standoff", 0.0),)
    yield chart("Distance error, m further than the standoff", "m", Line("error", follow.excess_m), levels=middle)
    yield chart(
        "Bearing error, deg right of the picture's middle", "deg", Line("error", follow.bearing_deg),
        levels=(Level("middle", 0.0), *_edges(config, report.provenance.video_size_px)),
    )  # fmt: skip
    sure = () if control is None else (
        Level("to confirm", control.engagement.confirm_confidence),
        Level("to come nearer", control.follow.closing_confidence),
    )  # fmt: skip
    yield chart("Confidence of the tracker, 0 to 1", "", Line("confidence", tally.confidence), levels=sure, zero=True)
    fence = None if control is None else control.limits.fence
    heights = () if fence is None else (Level("floor", fence.min_height_m), Level("ceiling", fence.max_height_m))
    yield chart("Height above home, m", "m", Line("height", tally.height_m), levels=heights, zero=True)
    yield chart("Battery, %", "%", Line("battery", tally.battery), zero=True)


def _edges(config: Config | None, size_px: tuple[int, int] | None) -> Iterator[Level]:
    """Of the picture, at half its height; none where its size is not known, or not that of the calibration."""
    if config is None or size_px is None:
        return
    try:
        camera = config.camera_model(*size_px)
    except ConfigError:
        return
    for name, u_px in (("right edge of the picture", float(camera.width_px)), ("left edge", 0.0)):
        right, _, forward = ray_camera(camera, u_px, camera.height_px / 2)
        yield Level(name, math.degrees(math.atan2(right, forward)))


def shades_of(report: Report) -> tuple[Shade, ...]:
    """Losses before the follows they belong to."""
    lost = [
        Shade(
            one.start_s, one.end_s, "unseen", f"not seen for {one.end_s - one.start_s:.1f} s", f"#{key_of('loss', n)}"
        )
        for n, one in enumerate(report.losses)
    ]
    followed = [
        Shade(one.start_s, one.end_s, "followed", f"followed from {clock(one.start_s)}", f"#{key_of('follow', n)}")
        for n, one in enumerate(report.follows)
    ]
    return (*lost, *followed)


def _drawn(chart: TimeChart) -> Html:
    """With its key where there are several curves; empty where there is none."""
    drawn = chart.svg()
    if not drawn:
        return Html("")
    beyond = ", ".join(f"{level.name} {number(level.value)}" for level in chart.beyond)
    names = [(f"k-{line.css}", line.name) for line in chart.lines if line.curve]
    key = legend(names) if len(names) > 1 else ""
    return figure(chart.title, drawn + key, f"far off, not drawn: {beyond}" if beyond else "")


def map_from_above(report: Report, tally: Tally, config: Config | None) -> Html:
    """The paths with their key."""
    fence = None if config is None else config.control.limits.fence
    drawn = from_above(tally.vehicle_path, tally.target_path, report.follows, fence, tally.knows_home)
    if not drawn:
        return note("The vehicle never told its position.")
    said = []
    if fence is None:
        said.append("" if report.provenance.is_import else "The fence is not in the record.")
    elif not is_in_sight(tally.vehicle_path, tally.target_path, fence):
        said.append(f"The fence, {fence.radius_m:g} m round home, lies outside the picture.")
    if fence is not None and fence.polygon_deg:
        said.append("The fence's polygon, given in degrees, is not drawn.")
    if tally.target_path.places:
        said.append("The target's place is what the station believed, from the line of sight and the distance.")
    names = [("k-soft", "vehicle")]
    if tally.target_path.places:
        names = [
            ("s-following", "vehicle, following"), ("s-lost", "target not seen"), ("k-soft", "vehicle otherwise"),
            ("k-a", "target, dotted; its standoff as a circle"),
        ]  # fmt: skip
    return Html(
        f'<div class="wide">{figure("", drawn)}</div>' + legend(names) + (note(" ".join(said)) if any(said) else "")
    )


def latency(report: Report, tally: Tally, config: Config | None) -> Html:
    """Histogram, table of the parts, and the total over time."""
    if not report.latency_ms:
        return Html("")
    bars = histogram(tally.latency.bins, report.latency_ms)
    colours = legend((f"part-{name}", f"{name}: {_PARTS_SAID[name]}") for name in PARTS)
    most = () if config is None else (Level("no follow above", config.control.engagement.max_latency_s * 1000),)
    over_time = TimeChart(
        "Latency over time, ms", "ms", (Line("latency", tally.latency.total_ms),), report.lasted_s, most,
        shades_of(report), zero=True,
    )  # fmt: skip
    rows = [
        (name, *(f"{value:.1f}" for value in (p.median_ms, p.p95_ms, p.p99_ms)))
        for name, p in report.latency_ms.items()
    ]
    spread = table(("part", "p50, ms", "p95, ms", "p99, ms"), rows)
    said = "A bar's height: how many pictures took so long. Its colours: where their time went, on average."
    side = f'<div class="grid2"><div>{spread}</div><div>{_drawn(over_time)}</div></div>'
    return Html(f'<div class="wide">{figure("Pictures by their latency", bars, said)}</div>' + colours + side)


def link(report: Report, tally: Tally) -> Html:
    """Loss, rates, setpoints and pauses over time."""
    of, span_s, shades = tally.link, report.lasted_s, shades_of(report)
    charts = (
        TimeChart("Lost of the vehicle's messages, %", "%", (Line("lost", of.loss),), span_s, (), shades, zero=True),
        TimeChart(
            "On the link, kB/s", "kB/s", (Line("received", of.received_kbps), Line("sent", of.sent_kbps, "b")), span_s,
            (), shades, zero=True,
        ),
        TimeChart(
            "Setpoints sent, a second", "/s", (Line("setpoints", of.setpoints_hz),), span_s, (), shades, zero=True,
        ),
        TimeChart(
            "Between two decisions, ms", "ms", (Line("pause", tally.pause_ms),), span_s, (Level("wanted", 50.0),),
            shades, zero=True,
        ),
    )  # fmt: skip
    shown = charts[:2] if report.provenance.is_import else charts
    drawn = "".join(_drawn(chart) for chart in shown)
    return Html(f'<div class="grid2">{drawn}</div>' if drawn else "")

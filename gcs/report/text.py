"""A report as text, for one screen."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gcs.errors import printable
from gcs.report.figures import Event, Report
from gcs.report.words import clock

_WIDTH: Final = 100
_MOST_EVENTS: Final = 24
_NAMES: Final = {"track": "tracker"}


def text_of(report: Report) -> str:
    """All of it, line by line."""
    return "\n".join(
        printable(_cut(line)) for part in (_head, _following, _latency, _rest, _timeline) for line in part(report)
    )


def _cut(line: str) -> str:
    return line if len(line) <= _WIDTH else f"{line[: _WIDTH - 3]}..."


def _head(report: Report) -> Iterator[str]:
    vehicle = report.autopilot or "vehicle unknown: no audit was logged"
    simulated = ", simulated" if report.provenance.simulated else ""
    yield f"flight {report.folder}: {report.began}, {clock(report.lasted_s)}, {vehicle}{simulated}"
    yield ""


def _following(report: Report) -> Iterator[str]:
    follow = report.following
    if not follow.confirmations:
        yield _row("followed", "nothing")
        return
    times = "once" if follow.confirmations == 1 else f"{follow.confirmations} times"
    yield _row("followed", f"{follow.seen_s:.1f} s seen, {follow.unseen_s:.1f} s unseen; confirmed {times}")
    lost = f"{follow.losses}, {follow.reacquired} found again by itself, the longest {follow.longest_loss_s:.1f} s"
    yield _row("lost", lost if follow.losses else "never")
    yield _row("bearing error", _figure(follow.bearing_rms_deg, "{:.2f} deg rms off the picture's middle"))
    distance = _figure(follow.distance_rms_frac, "{:.1%} of the standoff, rms, by the station's own estimate")
    yield _row("distance error", distance)
    limits = [f"{name} {seconds:.1f} s" for name, seconds in report.limits_s.items() if seconds >= 0.1]
    yield _row("limits that clipped", ", ".join(limits) or "none")


def _latency(report: Report) -> Iterator[str]:
    spread = report.latency_ms
    if not spread:
        return
    total = spread.get("total")
    if total is not None:
        yield _row("latency", f"{total.median_ms:.0f} ms median, {total.p95_ms:.0f} ms p95, light to command")
    parts = [f"{_NAMES.get(k, k)} {v.median_ms:.0f}/{v.p95_ms:.0f}" for k, v in spread.items() if k != "total"]
    yield _row("", "median/p95: " + ", ".join(parts[:4]))
    yield _row("", "            " + ", ".join(parts[4:]) + " ms")


def _rest(report: Report) -> Iterator[str]:
    if report.frames:
        yield _row("video", f"{report.frames} frames, {report.fps:.1f} a second")
    if report.longest_pause_s:
        yield _row("longest pause", f"{report.longest_pause_s * 1000:.0f} ms between two decisions (50 are wanted)")
    if (link := report.link) is not None:
        loss = f"loss up to {link.most_loss_frac:.0%}, {link.setpoints_sent} setpoints sent"
        yield _row("link", f"in {link.received_kbps:.1f}, out {link.sent_kbps:.1f} kB/s, {loss}")
    if (audit := report.audit) is not None:
        yield _row("parameters", f"{audit.fine} fine, {audit.advice} with advice, {audit.unsafe} unsafe")
        for said in audit.said:
            yield _row("", said)
    for number, problem in enumerate(report.problems):
        yield _row("" if number else "problems", problem)


def _timeline(report: Report) -> Iterator[str]:
    yield ""
    events, left = report.timeline, 0
    if len(events) > _MOST_EVENTS:
        left = len(events) - _MOST_EVENTS
        events = (*events[: _MOST_EVENTS // 2], *events[-_MOST_EVENTS // 2 :])
    for number, event in enumerate(events):
        if left and number == _MOST_EVENTS // 2:
            yield f"  ... {left} more, all of them with --json"
        yield _line(event)


def _line(event: Event) -> str:
    who = "" if event.kind == "state" else f"{event.kind} "
    return f"{clock(event.t_s):>9}  {who}{event.text}"


def _row(name: str, text: str) -> str:
    return f"  {name:<20}{text}"


def _figure(value: float | None, form: str) -> str:
    return "not in the messages" if value is None else form.format(value)

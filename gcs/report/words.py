"""What a flight came to, in plain sentences: first what happened, then what deserves a look."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from gcs.config import Config
from gcs.report.figures import Report

_MUCH_CLIPPED_FRAC: Final = 0.25
_LOSSY_FRAC: Final = 0.05
_LONG_GAP_S: Final = 0.2  # as long as the gate believes a request
_LATE_SHARE: Final = 0.8  # of the latency with which no follow may begin
_LOW_BATTERY_FRAC: Final = 0.3


def verdict_of(report: Report, config: Config | None) -> tuple[str, ...]:
    """config: as it was flown with, where that is known."""
    return (*_happened(report), *_look_at(report, config or Config()))


def clock(seconds: float) -> str:
    """Minutes and seconds, as 1:02.5."""
    minutes, rest_s = divmod(max(round(seconds, 1), 0.0), 60)
    return f"{math.floor(minutes)}:{rest_s:04.1f}"


def times(count: int) -> str:
    """How often."""
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def _happened(report: Report) -> Iterator[str]:
    follow = report.following
    if report.provenance.is_import:
        yield "Imported from the log of another station: what the vehicle did is told, nothing was followed by ClimRT."
        return
    if not follow.confirmations:
        yield "Nothing was followed."
        return
    whole_s = follow.seen_s + follow.unseen_s
    seen = "seen all the time" if not follow.losses else f"{follow.seen_s / max(whole_s, 1e-9):.0%} of the time seen"
    yield f"A target was followed for {clock(whole_s)} after {_confirmed(follow.confirmations)}, {seen}."
    if follow.losses:
        all_found = "found again" if follow.losses == 1 else "each time found again"
        again = {0: "not found again", follow.losses: all_found}
        found = again.get(follow.reacquired, f"found again {times(follow.reacquired)}")
        longest = f"the longest took {follow.longest_loss_s:.1f} s"
        yield f"It was lost {times(follow.losses)} and {found} by itself; {longest}."
    off = []
    if follow.bearing_rms_deg is not None:
        off.append(f"the camera pointed {follow.bearing_rms_deg:.1f} deg off it")
    if follow.distance_rms_frac is not None:
        off.append(f"the distance was {follow.distance_rms_frac:.0%} off the standoff")
    if off:
        yield f"While it was seen {' and '.join(off)} (rms)."
    often = [(one.name, one.total_s / whole_s) for one in report.clipped if one.name != "coasting" and whole_s > 0]
    if said := [f"{name} ({share:.0%} of the time)" for name, share in often if share > _MUCH_CLIPPED_FRAC]:
        yield f"What limited it most: {', '.join(said)}."
    if report.link is not None:
        sent, loss = report.link.setpoints_sent, report.link.most_loss_frac
        yield f"On the link {sent} setpoints went out; at its worst {loss:.0%} of the vehicle's messages were lost."
    if report.follows:
        yield f"{'It' if follow.confirmations == 1 else 'The last follow'} ended {report.follows[-1].ended}."


def _confirmed(count: int) -> str:
    return "one confirmation" if count == 1 else f"{count} confirmations"


def _look_at(report: Report, config: Config) -> Iterator[str]:
    follow, link, audit = report.following, report.link, report.audit
    if audit is not None and audit.unsafe:
        accepted = sum(found.accepted for found in audit.parameters if found.level == "unsafe")
        said = f", {accepted} of them accepted by the operator" if accepted else ""
        yield f"Look at the vehicle's parameters: {audit.unsafe} unsafe{said}."
    if follow.losses > follow.reacquired:
        yield "Look at the losses: not every one ended with the target found again."
    trimmed = [one for one in report.clipped if one.name.startswith("gate, trimmed")]
    if trimmed:  # docs/safety.md: the law's own limits come first, so the gate should have nothing to do
        said = ", ".join(f"{one.name.removeprefix('gate, trimmed: ')} {one.total_s:.1f} s" for one in trimmed)
        yield f"Look at what the gate took away: {said}. In ordinary flight it should find nothing."
    total = report.latency_ms.get("total")
    most_ms = config.control.engagement.max_latency_s * 1000
    if total is not None and total.p95_ms > _LATE_SHARE * most_ms:
        yield f"Look at the latency: {total.p95_ms:.0f} ms at p95, and above {most_ms:.0f} ms no follow may begin."
    if follow.longest_gap_s is not None and follow.longest_gap_s > _LONG_GAP_S:
        yield f"Look at the setpoints: for {follow.longest_gap_s * 1000:.0f} ms none was sent during a follow."
    if link is not None and link.most_loss_frac > _LOSSY_FRAC:
        yield f"Look at the link: {link.most_loss_frac:.0%} of the vehicle's messages were lost for a while."
    if report.battery_frac is not None and report.battery_frac[1] < _LOW_BATTERY_FRAC:
        yield f"Look at the battery: {report.battery_frac[1]:.0%} were left."
    if report.problems:
        yield "Look at the record itself: what is wrong with it is said at the end."

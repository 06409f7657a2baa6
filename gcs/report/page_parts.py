"""The sections of the page that are text and tables."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path
from typing import Final

from gcs.report.figures import Event, Report
from gcs.report.html import Bar, Html, lanes, legend, moment, note, pairs, table, text
from gcs.report.pictures import key_of
from gcs.report.words import clock

_CSS: Final = {
    "no video": "s-novideo", "idle": "s-idle", "selected": "s-selected", "engaging": "s-engaging",
    "following": "s-following", "coasting": "s-coasting", "lost, holding": "s-lost", "released": "s-released",
    "taken over": "s-taken",
}  # fmt: skip
_KINDS: Final = {"run": "flight", "demo": "demonstration", "import": "imported log"}
_LOOK: Final = "Look at "
_SAME_S: Final = 1e-6


def head(report: Report) -> Html:
    """Which flight."""
    source = report.provenance
    autopilot = "" if report.autopilot is None or report.autopilot in source.vehicle else report.autopilot
    vehicle = ", ".join(filter(None, (autopilot, source.vehicle))) or "vehicle unknown"
    simulated = "simulated" if source.simulated else ""
    said = " · ".join(filter(None, (_KINDS.get(source.kind, source.kind), simulated, report.began, vehicle)))
    return Html(f'<h1>{text(Path(report.folder).name)}</h1><p class="sub">{text(said)}</p>')


def summary(report: Report) -> Html:
    """The verdict and the figures that matter most."""
    items = "".join(
        f'<li class="look">{text(said)}</li>' if said.startswith(_LOOK) else f"<li>{text(said)}</li>"
        for said in report.verdict
    )
    tiles = "".join(
        f'<div class="tile"><b>{text(value)}</b><span>{text(name)}</span></div>' for name, value in _tiles(report)
    )
    return Html(f'<ul class="verdict">{items}</ul><div class="tiles">{tiles}</div>')


def _tiles(report: Report) -> Iterator[tuple[str, str]]:
    follow, total, link = report.following, report.latency_ms.get("total"), report.link
    yield "recorded", clock(report.lasted_s)
    if follow.confirmations:
        yield "followed, seen", clock(follow.seen_s)
        yield "followed, not seen", clock(follow.unseen_s)
        yield "lost / found again", f"{follow.losses} / {follow.reacquired}"
    if follow.bearing_rms_deg is not None:
        yield "bearing error, rms", f"{follow.bearing_rms_deg:.1f}°"
    if follow.distance_rms_frac is not None:
        yield "distance error, rms", f"{follow.distance_rms_frac:.0%}"
    if total is not None:
        yield "latency, p50 / p95", f"{total.median_ms:.0f} / {total.p95_ms:.0f} ms"
    if link is not None:
        yield "worst loss on the link", f"{link.most_loss_frac:.0%}"
    if report.battery_frac is not None:
        yield "battery, start to end", "{:.0%} → {:.0%}".format(*report.battery_frac)


def band(report: Report) -> Html:
    """The states as one coloured band; a click leads to the line of the table."""
    lines = {event.t_s: number for number, event in enumerate(report.timeline) if event.kind == "state"}
    bars = []
    for phase in report.phases:
        said = f"{phase.name.upper()}, {clock(phase.start_s)} to {clock(phase.end_s)}"
        title = "\n".join([said, *phase.reasons])
        number = lines.get(phase.start_s)
        href = "" if number is None else f"#t-{number}"
        bars.append(Bar(phase.start_s, phase.end_s, _CSS.get(phase.name, "s-idle"), title, href))
    if not bars:
        return Html("")
    there = [(css, name) for name, css in _CSS.items() if any(phase.name == name for phase in report.phases)]
    return Html(f'<div class="band">{lanes([("", bars)], report.lasted_s)}</div>{legend(there)}')


def timeline(report: Report) -> Html:
    """Every change and act; a time leads to the pictures of that moment where there are some."""
    cards = [(one.start_s, f"#{key_of('follow', n)}") for n, one in enumerate(report.follows)]
    cards += [(one.start_s, f"#{key_of('loss', n)}") for n, one in enumerate(report.losses)]
    began = _began(report)

    def row(number: int, event: Event) -> tuple[object, ...]:
        href = next((h for t, h in cards if event.kind == "state" and abs(t - event.t_s) < _SAME_S), "")
        what = Html(f'<span id="t-{number}">{text(event.text)}</span>')
        wall = "" if began is None else f"{began + timedelta(seconds=event.t_s):%H:%M:%S}"
        return moment(event.t_s, href), wall, event.kind, what

    rows = [row(number, event) for number, event in enumerate(report.timeline)]
    return table(("time", "clock", "", "what"), rows, "timeline")


def _began(report: Report) -> datetime | None:
    try:
        return datetime.fromisoformat(report.began)
    except ValueError:
        return None


def limits(report: Report) -> Html:
    """When each clipped, and for how long."""
    if not report.follows:
        return note("Nothing was followed.")
    if not report.clipped:
        return note("None: every request of the follow law passed as it was.")
    whole_s = max(report.following.seen_s + report.following.unseen_s, 1e-9)
    rows = []
    for one in report.clipped:
        css = "s-gate" if one.name.startswith("gate") else "s-limit"
        bars = [Bar(start, end, css, f"{one.name}, {clock(start)} to {clock(end)}") for start, end in one.spans]
        rows.append((f"{one.name}, {one.total_s:.1f}\u00a0s", bars))
    shares = (
        (one.name, f"{one.total_s:.1f} s", f"{one.total_s / whole_s:.1%}", moment(one.spans[0][0]))
        for one in report.clipped
    )
    said = note("What the gate took away is red: in ordinary flight the law's own limits (blue) come first.")
    return Html(lanes(rows, report.lasted_s) + said + table(("limit", "clipped", "of the follow", "first"), shares))


def link_figures(report: Report) -> Html:
    """Totals of link and video."""
    link, gap_s = report.link, report.following.longest_gap_s
    rows: list[tuple[object, object]] = (
        [("frames", f"{report.frames}, {report.fps:.1f} a second")] if report.frames else []
    )
    if report.longest_pause_s:
        rows.append(("longest pause", f"{report.longest_pause_s * 1000:.0f} ms between two decisions (50 are wanted)"))
    if gap_s is not None:
        rows.append(("longest gap", f"{gap_s * 1000:.0f} ms between two setpoints while following"))
    if link is not None:
        rows += [
            ("received, sent", f"{link.received_kbps:.1f}, {link.sent_kbps:.1f} kB/s on average"),
            ("worst loss", f"{link.most_loss_frac:.1%} of two seconds' messages"),
        ]
    if link is not None and not report.provenance.is_import:
        rows += [
            ("setpoints sent", link.setpoints_sent),
            ("dropped, too late", link.dropped_late),
            ("not MAVLink", f"{link.bad_frames} runs of bytes"),
        ]
    return pairs(rows)


def operator(report: Report) -> Html:
    """Orders with their answers, what stood against a confirmation, and what was said."""
    refused = Html('<span class="tag refused">refused</span>')
    orders = table(
        ("time", "order", "", "answer"),
        ((moment(one.t_s), one.order, refused if one.refused else "", one.answer) for one in report.orders),
    )
    against = table(
        ("from", "what would have refused a confirmation"),
        ((moment(one.t_s), "; ".join(one.reasons) or "nothing") for one in report.refusals),
    )
    said = table(("time", "by", "said"), ((moment(one.t_s), one.by, one.text) for one in report.said))
    named = (("Orders", orders), ("Refusals", against), ("Said", said))
    return Html("".join(f"<h3>{name}</h3>{body}" for name, body in named if body))


def parameters(report: Report) -> Html:
    """The audit's table, the worst first."""
    audit = report.audit
    if audit is None:
        return note("They were not looked at.")
    order = {"unsafe": 0, "advice": 1, "fine": 2}
    rows = []
    for one in sorted(audit.parameters, key=lambda p: order.get(p.level, 0)):
        level = f"{one.level}, accepted" if one.accepted else one.level
        tag = Html(f'<span class="tag {text(one.level)}">{text(level)}</span>')
        rows.append((one.name, "not read" if one.value is None else f"{one.value:g}", one.wanted, tag, one.why))
    counts = f"{audit.autopilot}: {audit.fine} fine, {audit.advice} with advice, {audit.unsafe} unsafe."
    return Html(f"<p>{text(counts)}</p>{table(('parameter', 'is', 'wanted', '', 'why'), rows)}")


def record(report: Report) -> Html:
    """What is wrong with the record, and what was flown with."""
    source = report.provenance
    wrong = "".join(f"<li>{text(problem)}</li>" for problem in report.problems)
    problems = f"<ul>{wrong}</ul>" if wrong else note("Nothing is missing in the record.")
    flown: list[tuple[object, object]] = [
        ("folder", report.folder), ("video", source.video), ("weights", source.weights),
        ("weights, sha256", source.weights_sha256), ("seed", "" if source.seed is None else source.seed),
    ]  # fmt: skip
    changed = table(("configuration", "value", "default"), ((c.key, c.value, c.default) for c in source.changed))
    named = (
        ("Software", pairs(source.software.items())), ("Machine", pairs(source.machine.items())),
        ("Configuration that is not the default", changed),
    )  # fmt: skip
    missing = "" if source.kind else note("There is no manifest: software, machine and configuration are not known.")
    return Html(problems + pairs(flown) + missing + "".join(f"<h3>{title}</h3>{body}" for title, body in named if body))

"""What it means what was heard of a vehicle. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from statistics import median
from typing import TYPE_CHECKING, Final

from gcs.doctor.check import Question, Result, fail, ok, skip, warn
from gcs.framing import dialect
from gcs.transport import Kind, parse_url

if TYPE_CHECKING:
    from gcs.doctor.vehicle import Heard

_ENOUGH_FRAC: Final = 0.5  # of the rate asked for, as in flight
_MUCH_LOSS_FRAC, _SOME_LOSS_FRAC = 0.2, 0.02
_SLOW_TRIP_S, _TOO_SLOW_TRIP_S = 0.2, 0.4
_CLOCK_S: Final = 60.0  # signed messages older than a minute are not believed
_OVERHEAD_BYTES: Final = 12  # of a MAVLink 2 frame
_BITS_PER_BYTE: Final = 10  # with start and stop bit


def judge(heard: Heard, question: Question) -> Iterator[Result]:
    """All of it."""
    yield _identity(heard)
    yield _rates(heard, question)
    yield _loss(heard)
    yield _round_trip(heard)
    yield from _bandwidth(heard, question.vehicle or "")
    yield _audit(heard)
    yield _clock(heard)
    yield _others(heard)


def _identity(heard: Heard) -> Result:
    where = "in the air" if heard.state.in_air else "armed" if heard.state.armed else "not armed"
    text = f"{heard.vehicle}, {heard.state.mode.value}, {where}, {heard.security}"
    if heard.state.in_air:
        return warn("vehicle", text, "run this on the ground, before the flight")
    return ok("vehicle", text)


def _rates(heard: Heard, question: Question) -> Result:
    """Attitude and position decide whether a follow may begin; the rest is worth having."""
    engagement = question.config.control.engagement
    needed_hz = {
        "HEARTBEAT": 1 / engagement.heartbeat_age_s,
        "ATTITUDE": max(engagement.min_attitude_rate_hz, 1 / engagement.telemetry_age_s),
        "LOCAL_POSITION_NED": 1 / engagement.telemetry_age_s,
        "GLOBAL_POSITION_INT": 1 / engagement.telemetry_age_s,
    }
    wanted_hz = {dialect.mavlink_map[stream.message_id].msgname: stream.rate_hz for stream in heard.streams}
    had = {name: heard.rates_hz.get(name, 0.0) for name in {**needed_hz, **wanted_hz}}
    too_slow = [f"{name} {had[name]:.1f} Hz (needs {hz:.1f})" for name, hz in needed_hz.items() if had[name] < hz]
    # What comes less than once a second cannot be counted in a few.
    slow = [
        f"{name} {had[name]:.1f} of {hz:g} Hz"
        for name, hz in wanted_hz.items()
        if had[name] < _ENOUGH_FRAC * hz and hz >= 1.0
    ]
    figures = {f"{name.lower()}_hz": hz for name, hz in had.items()}
    link = "use a faster link, end other programs that ask for telemetry, or raise the port's rate at the autopilot"
    if too_slow:
        return fail("telemetry", f"too slow to follow: {', '.join(too_slow)}", link, **figures)
    if slow:
        return warn("telemetry", f"slower than asked for: {', '.join(slow)}", link, **figures)
    attitude, position = had["ATTITUDE"], had["LOCAL_POSITION_NED"]
    return ok(
        "telemetry", f"attitude {attitude:.0f} Hz, position {position:.0f} Hz, all others as asked for", **figures
    )


def _loss(heard: Heard) -> Result:
    text = f"{100 * heard.loss_frac:.1f} % of its messages lost, {heard.received_bytes_per_s / 1000:.1f} kB/s received"
    figures = {"loss_frac": heard.loss_frac, "received_bytes_per_s": heard.received_bytes_per_s}
    fix = "move the antenna, lower the telemetry's rate, use a link with more room"
    if heard.loss_frac > _MUCH_LOSS_FRAC:
        return fail("link", text, fix, **figures)
    return warn("link", text, fix, **figures) if heard.loss_frac > _SOME_LOSS_FRAC else ok("link", text, **figures)


def _round_trip(heard: Heard) -> Result:
    if not heard.round_trips_s:
        return warn("round trip", "it does not answer TIMESYNC: it may not hear us", "can it send and receive here?")
    usual_s, worst_s = median(heard.round_trips_s), max(heard.round_trips_s)
    text = f"{1000 * usual_s:.0f} ms, at most {1000 * worst_s:.0f} ms"
    figures = {"round_trip_s": usual_s, "round_trip_worst_s": worst_s}
    fix = "use a faster link: every order and every picture's pose are late by half of it"
    if usual_s > _TOO_SLOW_TRIP_S:
        return fail("round trip", text, fix, **figures)
    return warn("round trip", text, fix, **figures) if usual_s > _SLOW_TRIP_S else ok("round trip", text, **figures)


def _bandwidth(heard: Heard, url: str) -> Iterator[Result]:
    """Of a serial line: what is asked for against what it carries."""
    endpoint = parse_url(url)
    if endpoint.kind is not Kind.SERIAL:
        return
    wanted = sum(
        stream.rate_hz * (dialect.mavlink_map[stream.message_id].unpacker.size + _OVERHEAD_BYTES)
        for stream in heard.streams
    )
    carried = endpoint.baud / _BITS_PER_BYTE
    text = f"{wanted / 1000:.1f} kB/s are asked for, {endpoint.baud} baud carry {carried / 1000:.1f}"
    if wanted > carried:
        fix = "half of each rate is enough to fly; a faster radio or a lower share for other programs gives more"
        yield warn("bandwidth", text, fix, wanted_bytes_per_s=wanted)
    else:
        yield ok("bandwidth", text, wanted_bytes_per_s=wanted)


def _audit(heard: Heard) -> Result:
    audit = heard.audit
    if audit.ok:
        return ok("parameters", f"{len(audit.findings)} looked at: a follow may start")
    names = [str(finding) for finding in audit.refusing]
    more = f", and {len(names) - 2} more" if len(names) > 2 else ""
    return fail("parameters", f"unsafe: {'; '.join(names[:2])}{more}", "`gcs audit` prints the lines that set them")


def _clock(heard: Heard) -> Result:
    if heard.clock_s is None:
        return skip("clock", "the vehicle does not say what time it has")
    text = f"the vehicle's is {abs(heard.clock_s):.1f} s {'ahead' if heard.clock_s > 0 else 'behind'}"
    if abs(heard.clock_s) > _CLOCK_S:
        return warn(
            "clock", text, "set this machine's clock (NTP): logs, and signed links, go by it", ahead_s=heard.clock_s
        )
    return ok("clock", text, ahead_s=heard.clock_s)


def _others(heard: Heard) -> Result:
    said = [f"another vehicle: {other}" for other in heard.others]
    if heard.stations:
        said.append(f"{heard.stations} other ground station{'s' if heard.stations > 1 else ''}")
    if said:
        return warn(
            "others",
            f"on the link: {', '.join(said)}",
            "let one station alone steer it; name the vehicle: vehicle.system_id",
        )
    return ok("others", "nobody else on the link")

"""The gain sweep: one gain after the other over its candidates, each flown in simulated time, the best one kept."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Final

from control.config import FollowConfig
from control.modes import FollowMode
from gcs.scenarios.catalogue import find
from gcs.scenarios.conditions import Conditions
from gcs.scenarios.measure import Row
from gcs.scenarios.run import fly
from gcs.tuning.airframe import measured
from sitl_mocks.dynamics import PX4, Airframe

Gains = Mapping[str, float]
PATHS: Final = ("sine", "zigzag")
RUNS: Final = ("zigzag-away", "stop-and-go")  # and where distance is held: to and fro alone, doing nothing is best
_SHORT_S: Final = 22.0  # of a flight while choosing; the result is flown in full
_AMISS: Final = 0.25  # an airframe's answer is never known better: gains must stand so much more and less of it
_GUESS_S: Final = 0.06  # nor is the delay


@dataclass(frozen=True, slots=True)
class Knob:
    """A gain of FollowConfig and what it may be, as factors of where the sweep begins with it."""

    name: str
    factors: tuple[float, ...]
    mode: FollowMode


KNOBS: Final = (
    Knob("yaw_gain_ps", (0.5, 0.7, 1.0, 1.4, 2.0), FollowMode.SPOTLIGHT),
    Knob("yaw_lag_s", (0.7, 1.0, 1.3), FollowMode.SPOTLIGHT),
    Knob("range_gain_ps", (0.5, 0.7, 1.0, 1.4, 2.0), FollowMode.FOLLOW),
    Knob("rate_lag_s", (0.6, 0.8, 1.0, 1.25), FollowMode.FOLLOW),
)


@dataclass(frozen=True, slots=True)
class Job:
    """What is known of the vehicle: its airframe, and from light to box at how many pictures a second."""

    airframe: Airframe
    delay_s: float = 0.1
    fps: float = 20.0
    noise_px: float = 2.0
    link_delay_s: float = 0.01


@dataclass(frozen=True, slots=True)
class Expected:
    """One way to fly, before and after: rms of bearing (deg) and distance (parts), smallest distance (m)."""

    path: str
    mode: FollowMode
    before: Row
    after: Row


@dataclass(frozen=True, slots=True)
class Tuned:
    """The gains to use, of FollowConfig, those that differ from the defaults; and what to expect of them."""

    gains: Gains
    expected: tuple[Expected, ...]


def begin_with(airframe: Airframe) -> dict[str, float]:
    """Before any flight: what follows from the airframe alone, the other gains as they are."""
    default = FollowConfig()
    yaw, own_yaw = measured(airframe, yaw=True), measured(PX4, yaw=True)
    velocity, own_velocity = measured(airframe, yaw=False), measured(PX4, yaw=False)
    slower = (velocity.dead_s + velocity.tau_s) / (own_velocity.dead_s + own_velocity.tau_s)
    return {
        "yaw_gain_ps": default.yaw_gain_ps,
        "yaw_lag_s": default.yaw_lag_s * yaw.tau_s / own_yaw.tau_s,
        "yaw_delay_s": default.yaw_delay_s + yaw.dead_s - own_yaw.dead_s,
        "range_gain_ps": default.range_gain_ps / slower,
        "rate_lag_s": default.rate_lag_s,
    }


def sweep(job: Job, pool: Executor, told: Callable[[str], None]) -> Tuned:
    """Fly them all; `told` hears of each gain. Takes a minute or two on two cores."""
    gains = {name: _bounded(name, value) for name, value in begin_with(job.airframe).items()}
    for knob in KNOBS:
        values = sorted({_bounded(knob.name, gains[knob.name] * factor) for factor in knob.factors})
        candidates = [{**gains, knob.name: value} for value in values]
        costs = list(_costs(job, candidates, knob.mode, pool))
        best = min(range(len(values)), key=costs.__getitem__)
        gains = candidates[best]
        told(f"{knob.name} {values[best]:.3g}: {_list(values, costs)}")
    expected = tuple(_expected(job, gains, pool))
    default = FollowConfig()
    return Tuned({name: value for name, value in gains.items() if value != getattr(default, name)}, expected)


def _costs(job: Job, candidates: Sequence[Gains], mode: FollowMode, pool: Executor) -> Iterator[float]:
    """Of each: the mean over both paths and over what the airframe and the delay may be in truth."""
    each_path = PATHS if mode is FollowMode.SPOTLIGHT else (*PATHS, *RUNS)
    flights = [
        _conditions(way, gains, mode, error_s) for gains in candidates for way, error_s in _ways(job) for _ in each_path
    ]
    paths = list(each_path) * (len(flights) // len(each_path))
    rows = list(pool.map(_short, paths, flights))
    each = len(rows) // len(candidates)
    for at in range(0, len(rows), each):
        yield math.fsum(map(cost, rows[at : at + each])) / each


def cost(row: Row) -> float:
    """A degree of bearing counts as much as two hundredths of distance; a flight that ended counts as none."""
    if row.refusal or row.unsafe or not math.isfinite(row.bearing_rms_deg):
        return math.inf
    return row.bearing_rms_deg + 50.0 * (row.distance_rms_frac or 0.0) + 100.0 * (1.0 - row.on_target_frac)


def _ways(job: Job) -> Iterator[tuple[Job, float]]:
    yield job, 0.0
    yield replace(job, airframe=_other(job.airframe, 1 + _AMISS)), _GUESS_S
    yield replace(job, airframe=_other(job.airframe, 1 - _AMISS)), -min(_GUESS_S, job.delay_s / 2)


def _other(frame: Airframe, slower: float) -> Airframe:
    yaw, horizontal = (replace(r, gain_ps=r.gain_ps / slower) for r in (frame.yaw, frame.horizontal))
    return replace(frame, yaw=yaw, horizontal=horizontal)


def _expected(job: Job, gains: Gains, pool: Executor) -> Iterator[Expected]:
    ways = [(path, mode) for path in PATHS for mode in (FollowMode.SPOTLIGHT, FollowMode.FOLLOW)]
    flights = [_conditions(job, each, mode) for each in ({}, gains) for _, mode in ways]
    rows = list(pool.map(_whole, [path for path, _ in ways] * 2, flights))
    for i, (path, mode) in enumerate(ways):
        yield Expected(path, mode, rows[i], rows[i + len(ways)])


def _conditions(job: Job, gains: Gains, mode: FollowMode, error_s: float = 0.0) -> Conditions:
    plain = Conditions(
        mode=mode, delay_s=job.delay_s, delay_error_s=error_s, fps=job.fps, noise_px=job.noise_px,
        link_delay_s=job.link_delay_s, airframe=job.airframe,
    )  # fmt: skip
    follow = replace(plain.config.follow, **gains)  # type: ignore[arg-type]  # all of them numbers
    return replace(plain, config=replace(plain.config, follow=follow))


def _short(path: str, conditions: Conditions) -> Row:
    return fly(replace(find(path), duration_s=_SHORT_S), conditions)


def _whole(path: str, conditions: Conditions) -> Row:
    return fly(find(path), conditions)


def _bounded(name: str, value: float) -> float:
    """Within the range the configuration allows, and no finer than it matters."""
    bounds = FollowConfig.__dataclass_fields__[name].metadata
    return float(f"{min(max(value, bounds['low']), bounds['high']):.2g}")


def _list(values: Iterable[float], costs: Iterable[float]) -> str:
    return ", ".join(f"{value:.3g} -> {cost_:.2f}" for value, cost_ in zip(values, costs, strict=True))

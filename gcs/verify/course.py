"""What a follow came to in figures, decision by decision: as flown, or as it would have been."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from dataclasses import dataclass, field
from typing import Final

from control.gate import Setpoint
from control.gate_limits import TICK_S
from control.types import Reason
from gcs.replay.log import Sent, TickRow
from gcs.tick import Tick

_LONGEST_TICK_S: Final = 0.5  # a longer one is a pause, not time that was spent in a state
_UNTRIMMED: Final = (Reason.PASSED, Reason.PRIMING, Reason.NO_REQUEST)


@dataclass(slots=True)
class Course:
    """`add` every tick. Times in s on the flight's clock; velocities NED in m/s, NaN where nothing was sent."""

    t_s: array[float] = field(default_factory=lambda: array("d"))
    north_mps: array[float] = field(default_factory=lambda: array("d"))
    east_mps: array[float] = field(default_factory=lambda: array("d"))
    down_mps: array[float] = field(default_factory=lambda: array("d"))
    yaw_rate_rps: array[float] = field(default_factory=lambda: array("d"))
    states: list[str] = field(default_factory=list)
    state_s: Counter[str] = field(default_factory=Counter)
    limited_s: Counter[str] = field(default_factory=Counter)

    def add(self, tick: Tick | TickRow) -> None:
        """The next decision."""
        step_s = min(max(tick.t_s - self.t_s[-1], 0.0), _LONGEST_TICK_S) if self.t_s else TICK_S
        self.t_s.append(tick.t_s)
        sent: Setpoint | Sent | None = tick.setpoint
        values = (math.nan,) * 4 if sent is None else (*sent.velocity_ned_mps, sent.yaw_rate_rps)
        for series, value in zip(
            (self.north_mps, self.east_mps, self.down_mps, self.yaw_rate_rps), values, strict=True
        ):
            series.append(value)
        state = tick.output.state.value
        self.states.append(state)
        self.state_s[state] += step_s  # type: ignore[assignment]
        limits = set(tick.request.limited_by) if tick.request is not None else set()
        if tick.gate not in _UNTRIMMED:
            limits.add(f"gate, {tick.gate.value}")
        for name in limits:
            self.limited_s[name] += step_s  # type: ignore[assignment]

    def figures(self) -> dict[str, float]:
        """By their names for a table; 0 where nothing was sent."""
        speeds = [math.hypot(n, e) for n, e in zip(self.north_mps, self.east_mps, strict=True)]
        slopes, turns = self._slopes(self.north_mps, self.east_mps), self._slopes(self.yaw_rate_rps)
        return {
            **{f"{state}, s": seconds for state, seconds in sorted(self.state_s.items())},
            "speed, rms m/s": _rms(speeds),
            "speed, most m/s": _most(speeds),
            "acceleration asked for, rms m/s2": _rms(slopes),
            "yaw rate, rms deg/s": math.degrees(_rms(self.yaw_rate_rps)),
            "yaw rate, most deg/s": math.degrees(_most(self.yaw_rate_rps)),
            "yaw acceleration asked for, rms deg/s2": math.degrees(_rms(turns)),
            **{f"limited by {name}, s": seconds for name, seconds in self.limited_s.most_common()},
        }

    def _slopes(self, *series: array[float]) -> list[float]:
        """Size of the change from tick to tick, per second; NaN where either was not sent, or an abort came between."""
        slopes = []
        for index in range(1, len(self.t_s)):
            step_s = self.t_s[index] - self.t_s[index - 1]
            change = math.hypot(*(each[index] - each[index - 1] for each in series))
            slopes.append(change / step_s if TICK_S / 2 < step_s <= _LONGEST_TICK_S else math.nan)
        return slopes


def apart(a: Course, b: Course) -> dict[str, float]:
    """How far two courses over the same ticks are from each other, where both sent something."""
    ways = zip(a.north_mps, b.north_mps, a.east_mps, b.east_mps, a.down_mps, b.down_mps, strict=True)
    velocity = [math.hypot(n - n2, e - e2, d - d2) for n, n2, e, e2, d, d2 in ways]
    turn = [x - y for x, y in zip(a.yaw_rate_rps, b.yaw_rate_rps, strict=True)]
    differing_s = sum(
        min(a.t_s[i] - a.t_s[i - 1], _LONGEST_TICK_S) for i in range(1, len(a.t_s)) if a.states[i] != b.states[i]
    )
    return {
        "velocity, rms m/s": _rms(velocity),
        "velocity, most m/s": _most(velocity),
        "yaw rate, rms deg/s": math.degrees(_rms(turn)),
        "yaw rate, most deg/s": math.degrees(_most(turn)),
        "in another state, s": differing_s,
    }


def _finite(values: object) -> list[float]:
    return [v for v in values if math.isfinite(v)]  # type: ignore[attr-defined]


def _rms(values: object) -> float:
    found = _finite(values)
    return math.sqrt(math.fsum(v * v for v in found) / len(found)) if found else 0.0


def _most(values: object) -> float:
    return max(map(abs, _finite(values)), default=0.0)

"""A judge on the wire: counts unsafe outcomes in what the vehicle really receives.

Knows pymavlink and nothing of the ground station; limits are its own, looser than the station's, so a hit is
a fault of the station and not of the tuning. Rules are the unsafe outcomes U1 to U8; A1 is the longest gap.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

Vec3 = tuple[float, float, float]

_BODY_FRAMES = (8, 9)
_LOCAL_NED, _BODY_NED = 1, 8
_YAW_RATE_IGNORE = 1 << 11
_NOMINAL_PERIOD_S = 0.05
_LONGEST_STEP_S = 0.2
_SILENCE_S = 0.5
_KEPT_REASONS = 200
_SET_MODE, _ARM, _TAKEOFF, _TERMINATE = 176, 400, 22, 185


class Rule(Enum):
    """Unsafe outcomes."""

    OVER_LIMIT = "U1"  # non-finite, over the limit, or a frame the vehicle does not take
    TOO_LATE = "U2"  # moving after it had to be still
    NOT_EXTERNAL = "U3"  # a setpoint although the vehicle is in someone else's mode
    UNCONFIRMED = "U4"  # external mode again without the operator
    FORBIDDEN_COMMAND = "U5"  # arm, take-off, terminate outside their phase
    WRONG_TARGET = "U6"
    OUTSIDE = "U7"  # fence or height left by more than the margin
    SLEW = "U8"


@dataclass(frozen=True, slots=True)
class Truth:
    """The vehicle's true state: NED metres with the origin at home, yaw in rad."""

    external: bool
    armed: bool
    in_air: bool
    position_ned_m: Vec3
    yaw_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class MonitorLimits:
    """What counts as unsafe. None = not judged."""

    horizontal_max_mps: float = 12.0
    vertical_max_mps: float = 3.0
    yaw_rate_max_rps: float = math.radians(120)
    accel_max_mps2: float = 4.0
    yaw_accel_max_rps2: float = math.radians(200)
    mode_grace_s: float = 1.1  # one heartbeat of PX4
    priming_s: float = 3.0  # zero setpoints before external mode: PX4 wants them first
    fence_radius_m: float | None = None
    height_min_m: float | None = None
    height_max_m: float | None = None
    margin_m: float = 1.0
    system_id: int = 1
    confirmation_needed: bool = False
    confirmation_lasts_s: float = 10.0
    forbidden_commands: Mapping[str, frozenset[int]] = field(
        default_factory=lambda: {"follow": frozenset({_ARM, _TAKEOFF, _TERMINATE})}
    )


@dataclass(frozen=True, slots=True)
class Reason:
    """One unsafe outcome."""

    t_s: float
    rule: Rule
    text: str


@dataclass(frozen=True, slots=True)
class _Seen:
    t_s: float
    frame: int
    velocity_mps: Vec3
    yaw_rate_rps: float

    @property
    def still(self) -> bool:
        return max(*map(abs, self.velocity_mps), abs(self.yaw_rate_rps)) < 1e-6


@dataclass(slots=True)
class WireMonitor:
    """Feed every datagram with `feed`, and `tick` each step; read `summary()`.

    phase: name that forbidden_commands refers to, set by the test ("setup", "follow").
    still_by_s: from this time on any moving setpoint counts (set it when a fault is injected).
    """

    limits: MonitorLimits = field(default_factory=MonitorLimits)
    phase: str = "setup"
    still_by_s: float | None = None
    reasons: list[Reason] = field(default_factory=list)
    counts: Counter[Rule] = field(default_factory=Counter)
    setpoints: int = 0
    moving_setpoints: int = 0
    broken: int = 0
    external_entries: int = 0
    max_gap_s: float = 0.0
    max_gap_t_s: float | None = None
    _last: _Seen | None = None
    _last_moving_t_s: float | None = None
    _run_start_s: float = 0.0
    _external: bool = False
    _left_external_s: float | None = None
    _gap_from_s: float | None = None
    _confirmed_s: float | None = None
    _outside: bool = False

    def operator_confirms(self, now_s: float) -> None:
        """The operator has just confirmed: allows one entry into external mode."""
        self._confirmed_s = now_s

    def tick(self, now_s: float, truth: Truth) -> None:
        """Follow the vehicle's true mode and place; call it at least every 50 ms."""
        if truth.external and not self._external:
            self._enter(now_s)
        elif self._external and not truth.external:
            self._left_external_s = now_s
        self._external = truth.external
        engaged = truth.external and truth.armed and truth.in_air
        if not engaged:
            self._gap_from_s = None
        elif self._gap_from_s is not None:
            self._note_gap(now_s, now_s - self._gap_from_s)
        self._check_place(now_s, truth, engaged)

    def feed(self, now_s: float, datagram: bytes, truth: Truth) -> None:
        """One datagram that reached the vehicle at now_s while it was in the state `truth`."""
        self.tick(now_s, truth)
        for message in _decode(datagram):
            match message.get_type():
                case "BAD_DATA":
                    self.broken += 1
                case "SET_POSITION_TARGET_LOCAL_NED":
                    self._setpoint(now_s, message, truth)
                case "COMMAND_LONG" | "COMMAND_INT":
                    self._command(now_s, message)

    def summary(self) -> dict[str, Any]:
        """Figures for a report, JSON-ready; times in s of the clock that was fed."""
        return {
            "unsafe": sum(self.counts.values()),
            "by_rule": {rule.value: count for rule, count in sorted(self.counts.items(), key=_by_value)},
            "reasons": [{"t_s": r.t_s, "rule": r.rule.value, "text": r.text} for r in self.reasons],
            "setpoints": self.setpoints,
            "moving_setpoints": self.moving_setpoints,
            "last_moving_setpoint_t_s": self._last_moving_t_s,
            "external_entries": self.external_entries,
            "max_setpoint_gap_s": self.max_gap_s,
            "max_setpoint_gap_t_s": self.max_gap_t_s,
            "broken_frames": self.broken,
        }

    # -- rules --------------------------------------------------------------------------------------------

    def _hit(self, now_s: float, rule: Rule, text: str) -> None:
        self.counts[rule] += 1
        if len(self.reasons) < _KEPT_REASONS:
            self.reasons.append(Reason(now_s, rule, text))

    def _note_gap(self, now_s: float, gap_s: float) -> None:
        if gap_s > self.max_gap_s:
            self.max_gap_s, self.max_gap_t_s = gap_s, now_s

    def _enter(self, now_s: float) -> None:
        self.external_entries += 1
        confirmed, self._confirmed_s = self._confirmed_s, None
        late = confirmed is None or now_s - confirmed > self.limits.confirmation_lasts_s
        if self.limits.confirmation_needed and late:
            self._hit(now_s, Rule.UNCONFIRMED, "external mode entered without a confirmation")

    def _check_place(self, now_s: float, truth: Truth, engaged: bool) -> None:
        limits, (north, east, down) = self.limits, truth.position_ned_m
        distance_m, height_m = math.hypot(north, east), -down
        radius, low, high = limits.fence_radius_m, limits.height_min_m, limits.height_max_m
        outside = engaged and (
            (radius is not None and distance_m > radius + limits.margin_m)
            or (low is not None and height_m < low - limits.margin_m)
            or (high is not None and height_m > high + limits.margin_m)
        )
        if outside and not self._outside:
            self._hit(now_s, Rule.OUTSIDE, f"{distance_m:.1f} m from home, {height_m:.1f} m high")
        self._outside = outside

    def _setpoint(self, now_s: float, message: Any, truth: Truth) -> None:
        self.setpoints += 1
        velocity = (message.vx, message.vy, message.vz)
        rate = 0.0 if message.type_mask & _YAW_RATE_IGNORE else message.yaw_rate
        seen = _Seen(now_s, message.coordinate_frame, velocity, rate)
        if message.target_system != self.limits.system_id:
            self._hit(now_s, Rule.WRONG_TARGET, f"setpoint to system {message.target_system}")
        self._check_values(seen)
        self._check_moving(seen)
        self._check_mode(seen, truth)
        self._check_slew(seen, truth.yaw_rad)
        if truth.external and truth.armed and truth.in_air:
            if self._gap_from_s is not None:
                self._note_gap(now_s, now_s - self._gap_from_s)
            self._gap_from_s = now_s
        self._last = seen

    def _check_values(self, seen: _Seen) -> None:
        limits, (x, y, z), rate = self.limits, seen.velocity_mps, seen.yaw_rate_rps
        if seen.frame not in (_LOCAL_NED, _BODY_NED):
            self._hit(seen.t_s, Rule.OVER_LIMIT, f"coordinate frame {seen.frame}")
        if not all(map(math.isfinite, (x, y, z, rate))):
            self._hit(seen.t_s, Rule.OVER_LIMIT, f"not finite: {seen.velocity_mps}, yaw rate {rate}")
            return
        slack = 1.0 + 1e-4
        over = (
            math.hypot(x, y) > limits.horizontal_max_mps * slack
            or abs(z) > limits.vertical_max_mps * slack
            or abs(rate) > limits.yaw_rate_max_rps * slack
        )
        if over:
            self._hit(seen.t_s, Rule.OVER_LIMIT, f"velocity {seen.velocity_mps}, yaw rate {rate:.3f} rad/s")

    def _check_moving(self, seen: _Seen) -> None:
        if seen.still:
            return
        self.moving_setpoints += 1
        self._last_moving_t_s = seen.t_s
        if self.still_by_s is not None and seen.t_s > self.still_by_s:
            self._hit(seen.t_s, Rule.TOO_LATE, f"moving {seen.t_s - self.still_by_s:.3f} s after the bound")

    def _check_mode(self, seen: _Seen, truth: Truth) -> None:
        last = self._last
        if last is None or seen.t_s - last.t_s > _SILENCE_S:
            self._run_start_s = seen.t_s
        if truth.external:
            return
        left = self._left_external_s
        if left is not None and seen.t_s - left <= self.limits.mode_grace_s:
            return
        priming = seen.still and seen.t_s - self._run_start_s <= self.limits.priming_s
        same_run = left is not None and self._run_start_s <= left
        if not priming or same_run:
            self._hit(seen.t_s, Rule.NOT_EXTERNAL, "setpoint while the vehicle is not in external mode")

    def _check_slew(self, seen: _Seen, yaw_rad: float) -> None:
        last = self._last
        if last is None or seen.t_s - last.t_s > _SILENCE_S:
            last = _Seen(seen.t_s - _NOMINAL_PERIOD_S, seen.frame, (0.0, 0.0, 0.0), 0.0)
        values = (*seen.velocity_mps, *last.velocity_mps, seen.yaw_rate_rps, last.yaw_rate_rps)
        if seen.still or not all(map(math.isfinite, values)):
            return  # an emergency stop may step to zero; other values have been counted already
        dt_s = min(max(seen.t_s - last.t_s, _NOMINAL_PERIOD_S), _LONGEST_STEP_S)
        before, after = last.velocity_mps, seen.velocity_mps
        if last.frame != seen.frame:
            before, after = _to_ned(last, yaw_rad), _to_ned(seen, yaw_rad)
        step_mps = math.dist(before, after)
        if step_mps > self.limits.accel_max_mps2 * dt_s + 1e-3:
            self._hit(seen.t_s, Rule.SLEW, f"velocity step {step_mps:.3f} m/s in {dt_s:.3f} s")
        step_rps = abs(seen.yaw_rate_rps - last.yaw_rate_rps)
        if step_rps > self.limits.yaw_accel_max_rps2 * dt_s + 1e-3 and abs(seen.yaw_rate_rps) > 1e-6:
            self._hit(seen.t_s, Rule.SLEW, f"yaw rate step {step_rps:.3f} rad/s in {dt_s:.3f} s")

    def _command(self, now_s: float, message: Any) -> None:
        if message.target_system != self.limits.system_id:
            self._hit(now_s, Rule.WRONG_TARGET, f"command {message.command} to system {message.target_system}")
        if message.command in self.limits.forbidden_commands.get(self.phase, frozenset()):
            self._hit(now_s, Rule.FORBIDDEN_COMMAND, f"command {message.command} in phase {self.phase}")


def _by_value(item: tuple[Rule, int]) -> str:
    return item[0].value


def _to_ned(seen: _Seen, yaw_rad: float) -> Vec3:
    x, y, z = seen.velocity_mps
    if seen.frame not in _BODY_FRAMES:
        return x, y, z
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return c * x - s * y, s * x + c * y, z


def _decode(datagram: bytes) -> Iterator[Any]:
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    for message in parser.parse_buffer(bytearray(datagram)) or ():
        if not message.get_type().startswith("UNKNOWN_"):
            yield message

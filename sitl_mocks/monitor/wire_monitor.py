"""The judge: every datagram that reaches the vehicle goes through `feed`, time through `tick`."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from sitl_mocks.monitor import frames
from sitl_mocks.monitor.availability import Availability
from sitl_mocks.monitor.engagement import Engagement
from sitl_mocks.monitor.gimbal import bad_rates, rates_rps, turning
from sitl_mocks.monitor.limits import (
    REQUEST_MESSAGE,
    SET_MESSAGE_INTERVAL,
    SET_MODE,
    MonitorLimits,
    Reason,
    Rule,
    Truth,
)
from sitl_mocks.monitor.place import why_outside
from sitl_mocks.monitor.setpoints import SILENCE_S, Seen, bad_values, steps
from sitl_mocks.monitor.targets import Targets

_KEPT_REASONS = 200
_ASKING = (REQUEST_MESSAGE, SET_MESSAGE_INTERVAL)  # may be asked of any component


@dataclass(slots=True)
class WireMonitor:
    """Feed every datagram with `feed`, and `tick` each step; read `summary()`.

    still_by_s, silent_by_s: from that time on any moving, or any setpoint at all counts; set when a fault is injected.
    phase: "follow" forbids the commands of a follow from the start; otherwise the monitor sees itself when the vehicle
    is being flown. availability.healthy: set while nothing is wrong, so that gaps and holds count too.
    """

    limits: MonitorLimits = field(default_factory=MonitorLimits)
    phase: str = "setup"
    still_by_s: float | None = None
    silent_by_s: float | None = None
    reasons: list[Reason] = field(default_factory=list)
    counts: Counter[Rule] = field(default_factory=Counter)
    setpoints: int = 0
    moving_setpoints: int = 0
    broken: int = 0
    last_setpoint_t_s: float | None = None
    last_moving_t_s: float | None = None
    late_after_external_s: float = 0.0  # the latest setpoint after the vehicle had left external mode
    engagement: Engagement = field(init=False)
    availability: Availability = field(init=False)
    targets: Targets = field(init=False)
    _last: Seen | None = None
    _run_start_s: float = 0.0
    _external: bool = False
    _left_external_s: float | None = None
    _outside: bool = False
    _decoder: Any = field(init=False, repr=False, default_factory=frames.make_decoder)

    def __post_init__(self) -> None:
        self.engagement = Engagement(self.limits)
        self.availability = Availability(self.limits)
        self.targets = Targets(self.limits)

    @property
    def external_entries(self) -> int:
        """How often the vehicle entered external mode."""
        return self.engagement.entries

    @property
    def max_gap_s(self) -> float:
        """The longest time without a setpoint while the vehicle obeyed them."""
        return self.availability.max_gap_s

    def operator_confirms(self, now_s: float) -> None:
        """The operator has just confirmed: allows flying under external control once."""
        self.engagement.confirm(now_s)

    def tick(self, now_s: float, truth: Truth) -> None:
        """Follow the vehicle's true mode and place; call it at least every 50 ms."""
        if self._external and not truth.external:
            self._left_external_s = now_s
        self._external = truth.external
        unconfirmed = self.engagement.watch(now_s, truth)
        if unconfirmed is not None and self.limits.confirmation_needed:
            self._hit(now_s, Rule.UNCONFIRMED, unconfirmed)
        if truth.obeys and not truth.follows_target:
            self._hit_if(now_s, Rule.UNAVAILABLE, self.availability.watch(now_s))
        else:
            self.availability.idle()
        outside = why_outside(truth.position_ned_m, self.limits) if truth.obeys else None
        if outside is not None and not self._outside:
            self._hit(now_s, Rule.OUTSIDE, outside)
        self._outside = outside is not None

    def feed(self, now_s: float, datagram: bytes, truth: Truth) -> None:
        """One datagram that reached the vehicle at now_s while it was in the state `truth`."""
        self.tick(now_s, truth)
        for message in frames.judged_messages(datagram, self._decoder):
            if message is None:
                self.broken += 1
                continue
            number = message.get_msgId()
            if number == frames.SETPOINT:
                self._setpoint(now_s, message, truth)
            elif number == frames.FOLLOW_TARGET:
                self._target(now_s, message, truth)
            else:
                self._other(now_s, number, message, truth)

    def summary(self) -> dict[str, Any]:
        """Figures for a report, JSON-ready; times in s of the clock that was fed."""
        by_rule = {rule.value: self.counts[rule] for rule in Rule if self.counts[rule]}
        return {
            "unsafe": sum(count for rule, count in self.counts.items() if rule is not Rule.UNAVAILABLE),
            "unavailable": self.counts[Rule.UNAVAILABLE],
            "by_rule": by_rule,
            "reasons": [{"t_s": r.t_s, "rule": r.rule.value, "text": r.text} for r in self.reasons],
            "setpoints": self.setpoints,
            "targets": self.targets.count,
            "moving_setpoints": self.moving_setpoints,
            "last_setpoint_t_s": self.last_setpoint_t_s,
            "last_moving_setpoint_t_s": self.last_moving_t_s,
            "late_after_external_s": self.late_after_external_s,
            "external_entries": self.external_entries,
            "max_setpoint_gap_s": self.availability.max_gap_s,
            "max_setpoint_gap_t_s": self.availability.max_gap_t_s,
            "broken_frames": self.broken,
        }

    def _hit(self, now_s: float, rule: Rule, text: str) -> None:
        self.counts[rule] += 1
        if len(self.reasons) < _KEPT_REASONS:
            self.reasons.append(Reason(now_s, rule, text))

    def _hit_if(self, now_s: float, rule: Rule, text: str | None) -> None:
        if text is not None:
            self._hit(now_s, rule, text)

    # -- setpoints ----------------------------------------------------------------------------------------

    def _setpoint(self, now_s: float, message: Any, truth: Truth) -> None:
        seen = Seen.of(message, now_s)
        self.setpoints += 1
        self.last_setpoint_t_s = now_s
        self._check_target(now_s, message, "setpoint")
        for text in bad_values(seen, self.limits):
            self._hit(now_s, Rule.OVER_LIMIT, text)
        for text in steps(seen, self._last, truth.yaw_rad, self.limits):
            self._hit(now_s, Rule.SLEW, text)
        self._check_bound(seen)
        self._check_mode(seen, truth)
        unconfirmed = self.engagement.setpoint(now_s, truth, still=seen.still)
        if self.limits.confirmation_needed:
            self._hit_if(now_s, Rule.UNCONFIRMED, unconfirmed)
        if truth.obeys:
            self._hit_if(now_s, Rule.UNAVAILABLE, self.availability.setpoint(now_s, still=seen.still))
        self._last = seen

    def _check_bound(self, seen: Seen) -> None:
        t_s = seen.t_s
        if self.silent_by_s is not None and t_s > self.silent_by_s:
            self._hit(t_s, Rule.TOO_LATE, f"a setpoint {t_s - self.silent_by_s:.3f} s after it had to be silent")
        if seen.still:
            return
        self.moving_setpoints += 1
        self.last_moving_t_s = t_s
        if self.still_by_s is not None and t_s > self.still_by_s:
            self._hit(t_s, Rule.TOO_LATE, f"moving {t_s - self.still_by_s:.3f} s after the bound")

    def _check_mode(self, seen: Seen, truth: Truth) -> None:
        last = self._last
        if last is None or seen.t_s - last.t_s > SILENCE_S:
            self._run_start_s = seen.t_s
        if truth.external and not truth.follows_target:
            return
        left = self._left_external_s
        same_run = left is not None and self._run_start_s <= left
        if left is not None and same_run:
            self.late_after_external_s = max(self.late_after_external_s, seen.t_s - left)
        if left is not None and seen.t_s - left <= self.limits.mode_grace_s:
            return
        priming = seen.still and seen.t_s - self._run_start_s <= self.limits.priming_s
        if not priming or same_run:
            self._hit(seen.t_s, Rule.NOT_EXTERNAL, "setpoint while the vehicle is not in external mode")

    def _target(self, now_s: float, message: Any, truth: Truth) -> None:
        for rule, text in self.targets.judge(now_s, message, truth, self._left_external_s):
            self._hit(now_s, rule, text)
        still = self.targets.still(message)
        if self.silent_by_s is not None and now_s > self.silent_by_s:
            self._hit(now_s, Rule.TOO_LATE, f"a target {now_s - self.silent_by_s:.3f} s after it had to be silent")
        if self.still_by_s is not None and now_s > self.still_by_s and not still:
            self._hit(now_s, Rule.TOO_LATE, f"a moving target {now_s - self.still_by_s:.3f} s after the bound")
        unconfirmed = self.engagement.setpoint(now_s, truth, still=still)
        if self.limits.confirmation_needed:
            self._hit_if(now_s, Rule.UNCONFIRMED, unconfirmed)

    # -- everything else ----------------------------------------------------------------------------------

    def _gimbal(self, now_s: float, message: Any, truth: Truth) -> None:
        rates = rates_rps(message)
        if rates is None:
            return
        self._hit_if(now_s, Rule.OVER_LIMIT, bad_rates(rates, self.limits))
        left_s = -math.inf if self._left_external_s is None else self._left_external_s
        if turning(rates) and not truth.external and now_s - left_s > self.limits.mode_grace_s:
            self._hit(now_s, Rule.NOT_EXTERNAL, "the gimbal is turned while the vehicle is not in external mode")

    def _check_target(self, now_s: float, message: Any, what: str, *, any_component: bool = False) -> None:
        system, component = message.target_system, getattr(message, "target_component", self.limits.component_id)
        wrong = component != self.limits.component_id and not any_component
        if system != self.limits.system_id or wrong:
            self._hit(now_s, Rule.WRONG_TARGET, f"{what} to system {system}, component {component}")

    def _other(self, now_s: float, number: int, message: Any, truth: Truth) -> None:
        command = message.command if number in (frames.COMMAND_INT, frames.COMMAND_LONG) else None
        if number in frames.OTHER_SETPOINTS:
            self._hit(now_s, Rule.OVER_LIMIT, f"a {message.get_type()} instead of a velocity")
        self._gimbal(now_s, message, truth)
        if command is not None:
            self._check_target(now_s, message, f"command {command}", any_component=command in _ASKING)
        if command == SET_MODE or number == frames.MODE:
            self._mode_request(now_s, truth)
        following = self.engagement.following or self.phase == "follow"
        forbidden = self.limits.forbidden_commands if following else self.limits.never_commands
        if command in forbidden:
            self._hit(now_s, Rule.FORBIDDEN_COMMAND, f"command {command}{' while following' if following else ''}")
        elif following and (number == frames.PARAM_SET or number in frames.STICKS):
            self._hit(now_s, Rule.FORBIDDEN_COMMAND, f"{message.get_type()} while following")

    def _mode_request(self, now_s: float, truth: Truth) -> None:
        self.engagement.order(now_s)
        if self.availability.healthy and truth.obeys:
            self._hit(now_s, Rule.UNAVAILABLE, "a mode request although all is well")

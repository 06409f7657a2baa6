"""What is published for the vehicle's own follow mode (FOLLOW_TARGET): sound, not jumping, only in that mode."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from sitl_mocks.monitor.limits import MonitorLimits, Rule, Truth

_DEGREE_M = math.radians(6_378_137.0)
_SLACK_M, _SLACK_FRAC = 0.5, 1.2  # of the step between two targets
_ANEW_S = 1.0  # after such a silence a target begins anew
_POSITION = 1
_STILL = 1e-6


@dataclass(slots=True)
class Targets:
    """Give it every target that reaches the vehicle; count, last_t_s and last_moving_t_s are for reports."""

    limits: MonitorLimits
    count: int = 0
    last_t_s: float | None = None
    last_moving_t_s: float | None = None
    _last_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def judge(self, now_s: float, message: Any, truth: Truth, left_t_s: float | None) -> Iterator[tuple[Rule, str]]:
        """What is unsafe about it; left_t_s: when the vehicle left its follow mode."""
        self.count += 1
        place_m = self._place_m(message)
        if not all(map(math.isfinite, (*place_m, *message.vel))) or not message.est_capabilities & _POSITION:
            yield Rule.OVER_LIMIT, f"no target: {message}"
            return
        if math.hypot(*message.vel) > self.limits.horizontal_max_mps * (1 + 1e-4):
            yield Rule.OVER_LIMIT, f"a target at {math.hypot(*message.vel):.1f} m/s"
        gap_s = math.inf if self.last_t_s is None else now_s - self.last_t_s
        step_m = math.dist(place_m, self._last_m)
        if gap_s < _ANEW_S and step_m > self.limits.horizontal_max_mps * gap_s * _SLACK_FRAC + _SLACK_M:
            yield Rule.SLEW, f"the target jumps {step_m:.2f} m in {gap_s:.3f} s"
        if not truth.follows_target and (left_t_s is None or now_s - left_t_s > self.limits.mode_grace_s):
            yield Rule.NOT_EXTERNAL, "a target while the vehicle is not in its own follow mode"
        self.last_t_s, self._last_m = now_s, place_m
        if not self.still(message):
            self.last_moving_t_s = now_s

    @staticmethod
    def still(message: Any) -> bool:
        """It is said to stand."""
        return bool(max(map(abs, message.vel)) < _STILL)

    def _place_m(self, message: Any) -> tuple[float, float, float]:
        latitude, longitude = message.lat / 1e7, message.lon / 1e7
        return latitude * _DEGREE_M, longitude * _DEGREE_M * math.cos(math.radians(latitude)), -message.alt

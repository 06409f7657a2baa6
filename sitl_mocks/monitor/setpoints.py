"""One setpoint by itself and against the one before: values (U1) and steps (U8)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from sitl_mocks.monitor.limits import MonitorLimits, Vec3

SILENCE_S = 0.5  # a stream that was silent that long begins again
_LOCAL_NED, _BODY_NED = 1, 8
_POSITION_OR_ACCELERATION, _VELOCITY_IGNORE, _YAW_RATE_IGNORE = 0x1C7, 0x38, 1 << 11
_NOMINAL_PERIOD_S, _LONGEST_STEP_S = 0.05, 0.2
_STILL = 1e-6


@dataclass(frozen=True, slots=True)
class Seen:
    """A SET_POSITION_TARGET_LOCAL_NED as it arrived: m/s in its own frame, rad/s."""

    t_s: float
    frame: int
    mask: int
    velocity_mps: Vec3
    yaw_rate_rps: float

    @classmethod
    def of(cls, message: Any, now_s: float) -> Seen:
        """What the vehicle will make of the message."""
        mask = message.type_mask
        velocity = (0.0,) * 3 if mask & _VELOCITY_IGNORE == _VELOCITY_IGNORE else (message.vx, message.vy, message.vz)
        rate = 0.0 if mask & _YAW_RATE_IGNORE else message.yaw_rate
        return cls(now_s, message.coordinate_frame, mask, velocity, rate)

    @property
    def still(self) -> bool:
        """Asks for no motion; NaN is motion."""
        (x, y, z), rate = self.velocity_mps, self.yaw_rate_rps
        return abs(x) < _STILL and abs(y) < _STILL and abs(z) < _STILL and abs(rate) < _STILL


def bad_values(seen: Seen, limits: MonitorLimits) -> Iterator[str]:
    """U1, in words."""
    (x, y, z), rate = seen.velocity_mps, seen.yaw_rate_rps
    if seen.frame not in (_LOCAL_NED, _BODY_NED):
        yield f"coordinate frame {seen.frame}"
    if seen.mask & _POSITION_OR_ACCELERATION != _POSITION_OR_ACCELERATION:
        yield f"type mask {seen.mask:#x} controls more than velocity"
    if not all(map(math.isfinite, (x, y, z, rate))):
        yield f"not finite: {seen.velocity_mps}, yaw rate {rate}"
        return
    slack = 1.0 + 1e-4
    over = (
        math.hypot(x, y) > limits.horizontal_max_mps * slack
        or abs(z) > limits.vertical_max_mps * slack
        or abs(rate) > limits.yaw_rate_max_rps * slack
    )
    if over:
        yield f"velocity {seen.velocity_mps}, yaw rate {rate:.3f} rad/s"


def steps(seen: Seen, last: Seen | None, yaw_rad: float, limits: MonitorLimits) -> Iterator[str]:
    """U8, in words. An emergency stop may step to zero; what is not finite is counted elsewhere."""
    if last is None or seen.t_s - last.t_s > SILENCE_S:
        last = Seen(seen.t_s - _NOMINAL_PERIOD_S, seen.frame, seen.mask, (0.0, 0.0, 0.0), 0.0)
    values = (*seen.velocity_mps, *last.velocity_mps, seen.yaw_rate_rps, last.yaw_rate_rps)
    if seen.still or not all(map(math.isfinite, values)):
        return
    dt_s = min(max(seen.t_s - last.t_s, _NOMINAL_PERIOD_S), _LONGEST_STEP_S)
    before, after = last.velocity_mps, seen.velocity_mps
    if last.frame != seen.frame:
        before, after = _to_ned(last, yaw_rad), _to_ned(seen, yaw_rad)
    step_mps = math.dist(before, after)
    if step_mps > limits.accel_max_mps2 * dt_s + 1e-3 and max(map(abs, after)) > _STILL:
        yield f"velocity step {step_mps:.3f} m/s in {dt_s:.3f} s"
    step_rps = abs(seen.yaw_rate_rps - last.yaw_rate_rps)
    if step_rps > limits.yaw_accel_max_rps2 * dt_s + 1e-3 and abs(seen.yaw_rate_rps) > _STILL:
        yield f"yaw rate step {step_rps:.3f} rad/s in {dt_s:.3f} s"


def _to_ned(seen: Seen, yaw_rad: float) -> Vec3:
    x, y, z = seen.velocity_mps
    if seen.frame == _LOCAL_NED:
        return x, y, z
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return c * x - s * y, s * x + c * y, z

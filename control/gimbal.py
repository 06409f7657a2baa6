"""A camera on a gimbal: the gimbal turns to the target quickly, the vehicle's nose follows the gimbal slowly.

Angles are the camera's own against NED: yaw clockwise from north, pitch up is positive. `relative_yaw_rad` is
the gimbal's yaw against the vehicle's nose, which is what its stops are about. Pure: time is an argument.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from control.attitude import wrap_pi
from control.config import GimbalConfig
from control.gate_limits import TICK_S
from control.motion import fade
from control.types import TargetState, VehicleState

_LONGEST_STEP_S = 0.1
_KEPT = 20  # requests, a second's worth


@dataclass(frozen=True, slots=True)
class GimbalLimits:
    """What the gimbal says of itself, rad; yaw against the vehicle's nose, infinite where it may turn on and on.

    has_yaw: False for one that only tilts. yaw_lock: its yaw rate counts from north, not from the nose.
    """

    pitch_min_rad: float = -math.pi / 2
    pitch_max_rad: float = math.pi / 2
    yaw_min_rad: float = -math.pi
    yaw_max_rad: float = math.pi
    has_yaw: bool = True
    yaw_lock: bool = True


@dataclass(frozen=True, slots=True)
class GimbalState:
    """Where the camera looks (rad, NED) at t_s and how it turned (rad/s) at rate_t_s; ours: we are in control."""

    t_s: float
    pitch_rad: float
    yaw_rad: float
    relative_yaw_rad: float
    pitch_rate_rps: float
    yaw_rate_rps: float
    rate_t_s: float
    limits: GimbalLimits
    ours: bool = False


@dataclass(frozen=True, slots=True)
class GimbalRequest:
    """Rates wanted of the gimbal, rad/s: pitch up, and yaw clockwise from above (from north with yaw_lock)."""

    t_s: float
    pitch_rate_rps: float = 0.0
    yaw_rate_rps: float = 0.0


class Pointing:
    """The fast loop: line of sight minus camera to rates.

    What was asked for last bounds what is asked for next, and what is still under way is counted as done: an
    attitude is as old as the link makes it, and so is the command that answers it.
    """

    def __init__(self, config: GimbalConfig) -> None:
        self._config = config
        self._last: GimbalRequest | None = None
        self._asked: deque[tuple[float, float, float]] = deque(maxlen=_KEPT)  # time, pitch and yaw from north

    def rest(self, now_s: float) -> GimbalRequest:
        """The deliberate stop, in one step."""
        self._last = GimbalRequest(now_s)
        self._asked.append((now_s, 0.0, 0.0))
        return self._last

    def follow(
        self, target: TargetState, gimbal: GimbalState, vehicle: VehicleState, now_s: float, factor: float = 1.0
    ) -> GimbalRequest:
        """Rates of this tick. target: predicted to half a tick after they arrive. factor: fades them, 0 to 1."""
        config, limits = self._config, gimbal.limits
        link_s = max(target.t_s - TICK_S / 2 - now_s, 0.0)
        pitch_rad, pitch_rps = self._ahead(1, gimbal.pitch_rad, gimbal.pitch_rate_rps, gimbal, target.t_s, link_s)
        yaw_rad, yaw_rps = self._ahead(2, gimbal.yaw_rad, gimbal.yaw_rate_rps, gimbal, target.t_s, link_s)
        pitch = _rate_rps(wrap_pi(target.elevation_rad - pitch_rad), target.elevation_rate_rps, pitch_rps, config)
        low, high = _room(pitch_rad, limits.pitch_min_rad, limits.pitch_max_rad, config)
        pitch = min(max(factor * pitch, low), high)
        yaw = 0.0
        if limits.has_yaw:
            forward_rps = target.azimuth_rate_rps * fade(target.azimuth_rate_std_rps, config.feed_forward_std_rps)
            yaw = _rate_rps(wrap_pi(target.azimuth_rad - yaw_rad), forward_rps, yaw_rps, config)
            relative_rad = gimbal.relative_yaw_rad + yaw_rad - gimbal.yaw_rad
            low, high = _room(relative_rad, limits.yaw_min_rad, limits.yaw_max_rad, config)
            # The stops turn with the vehicle, and without a lock so does the whole gimbal.
            relative = min(max(factor * yaw - vehicle.yaw_rate_rps, low), high)
            yaw = relative + vehicle.yaw_rate_rps if limits.yaw_lock else relative
        self._last = self._bounded(GimbalRequest(now_s, pitch, yaw))
        if gimbal.ours:
            carried_rps = 0.0 if limits.yaw_lock else vehicle.yaw_rate_rps
            self._asked.append((now_s, self._last.pitch_rate_rps, self._last.yaw_rate_rps + carried_rps))
        return self._last

    def _ahead(
        self, axis: int, angle_rad: float, rate_rps: float, gimbal: GimbalState, to_s: float, link_s: float
    ) -> tuple[float, float]:
        """Angle and rate of an axis at to_s, with what has been asked of it by now."""
        asked = [(each[0] + link_s, each[axis]) for each in self._asked]
        _, rate_rps = _answer(0.0, rate_rps, gimbal.rate_t_s, gimbal.t_s, asked, self._config.lag_s)
        return _answer(angle_rad, rate_rps, gimbal.t_s, to_s, asked, self._config.lag_s)

    def _bounded(self, wish: GimbalRequest) -> GimbalRequest:
        """Within rate and acceleration, from what was asked for last."""
        last = self._last or GimbalRequest(wish.t_s)
        step_rps = self._config.max_acceleration_rps2 * min(max(wish.t_s - last.t_s, 0.0), _LONGEST_STEP_S)
        most_rps = self._config.max_rate_rps
        pitch, yaw = (
            min(max(new, old - step_rps, -most_rps), old + step_rps, most_rps)
            for old, new in (
                (last.pitch_rate_rps, wish.pitch_rate_rps),
                (last.yaw_rate_rps, wish.yaw_rate_rps),
            )
        )
        return GimbalRequest(wish.t_s, pitch, yaw)


def hand_over_rps(target: TargetState, gimbal: GimbalState, config: GimbalConfig) -> float:
    """The slow loop: the vehicle's yaw rate (rad/s) that brings the gimbal back to the middle.

    Within the dead band the nose rests. Towards a stop the target's own bearing rate comes in, so that the nose
    keeps pace before the gimbal has to stop.
    """
    angle_rad = gimbal.relative_yaw_rad
    size_rad = abs(angle_rad)
    rate = math.copysign(config.hand_over_gain_ps * max(size_rad - config.dead_band_rad, 0.0), angle_rad)
    stop_rad = gimbal.limits.yaw_max_rad if angle_rad > 0 else -gimbal.limits.yaw_min_rad
    from_rad = config.pace_from_frac * stop_rad
    if math.isfinite(stop_rad) and size_rad > from_rad:
        near = min((size_rad - from_rad) / max(stop_rad - config.stop_margin_rad - from_rad, 1e-3), 1.0)
        forward = target.azimuth_rate_rps * fade(target.azimuth_rate_std_rps, config.feed_forward_std_rps)
        rate += near * (max(forward, 0.0) if angle_rad > 0 else min(forward, 0.0))
    return min(max(rate, -config.max_hand_over_rps), config.max_hand_over_rps)


def _rate_rps(error_rad: float, forward_rps: float, rate_rps: float, config: GimbalConfig) -> float:
    """P with feed-forward, and the lag of the gimbal's own rate loop answered ahead of time."""
    lag = config.lag_s * config.gain_ps * (forward_rps - rate_rps)
    return config.gain_ps * error_rad + forward_rps + lag


def _answer(
    angle_rad: float, rate_rps: float, from_s: float, to_s: float, commands: Iterable[tuple[float, float]], lag_s: float
) -> tuple[float, float]:
    """Angle and rate at to_s of what follows rates (when they act, rad/s) with a first-order lag."""
    wanted_rps, at_s = 0.0, from_s
    for act_s, command_rps in (*commands, (to_s, 0.0)):
        step_s = min(act_s, to_s) - at_s
        if step_s > 0:
            left = math.exp(-step_s / lag_s) if lag_s > 0 else 0.0
            angle_rad += wanted_rps * step_s + (rate_rps - wanted_rps) * lag_s * (1 - left)
            rate_rps = wanted_rps + (rate_rps - wanted_rps) * left
            at_s += step_s
        wanted_rps = command_rps
    return angle_rad, rate_rps


def _room(angle_rad: float, low_rad: float, high_rad: float, config: GimbalConfig) -> tuple[float, float]:
    """Rates allowed at this angle: none further towards a stop, and less and less on the way there."""
    low = min(config.stop_gain_ps * (low_rad + config.stop_margin_rad - angle_rad), 0.0)
    high = max(config.stop_gain_ps * (high_rad - config.stop_margin_rad - angle_rad), 0.0)
    return low, high

"""The yaw law: turn the camera's axis onto the predicted target, as quickly as the vehicle can and no more nervously.

A plan (heading, rate) runs ahead of the vehicle: where it will point when the command of this tick begins to act. The
plan goes after the target within the acceleration that a yaw rate can buy, and the command is what makes a vehicle of
the configured lag do as planned. The target's azimuth does not depend on the vehicle's heading, so no gain of the plan
closes a loop; what the vehicle does otherwise than planned is corrected with small gains, which a vehicle three times
as quick or half as quick still takes without ringing.

Small errors are mostly noise and large ones are turns of the target: the gains grow with the error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from control.attitude import wrap_pi
from control.camera import CameraModel
from control.config import FollowConfig
from control.gate_limits import TICK_S
from control.motion import fade
from control.types import TargetState, VehicleState

# So long after a follow began the vehicle turns gently: were the camera a mirrored one, it would turn away from the
# target, and that must be noticed while the target is still in view (control.camera_check).
_GENTLE_S = 1.5
_GENTLE_RPS = math.radians(30)
_GENTLE_RPS2 = math.radians(90)
_STALE_S = 0.2  # after a gap this long the plan begins again where the vehicle is
_MAX_AHEAD_S = 0.6  # the vehicle's own motion is predicted no further
_KEPT_S = 1.0  # commands, for that prediction
_CALM_GAIN_PS = 0.6
_KNEE_RAD = math.radians(1.0)  # error of heading at which its gain is half way from calm to yaw_gain_ps
_CALM_RATE_GAIN_PS = 1.4
_RATE_GAIN_PS = 16.0
_DAMPING = 1.6  # the rate's gain is at least so many times the heading's
_KNEE_RPS = math.radians(20)
_STEADY_S = 1.0  # time constant at which a lasting acceleration of the target is learnt;
_MAX_STEADY_RPS2 = math.radians(20)  # more is a turn, which does not last
_HEADING_CORRECTION_PS = 2.0
_RATE_CORRECTION = 0.3
_MAX_CORRECTION_RPS = math.radians(30)

Sent = tuple[float, float]  # when (s), yaw rate (rad/s)
Heading = tuple[float, float]  # rad, rad/s


@dataclass(frozen=True, slots=True)
class YawState:
    """The plan at the moment the command of tick t_s begins to act. correction_rps: in the command, not in the plan."""

    began_s: float
    t_s: float
    heading_rad: float
    rate_rps: float
    steady_rps2: float = 0.0
    correction_rps: float = 0.0
    sent: tuple[Sent, ...] = ()


def yaw_rate_rps(
    target: TargetState,
    vehicle: VehicleState,
    camera: CameraModel,
    now_s: float,
    state: YawState | None,
    last: Sent,
    config: FollowConfig,
    acceleration_rps2: float,
) -> tuple[float, YawState]:
    """The yaw rate (clockwise from above) to ask for in this tick, and the state after it.

    last: the newest yaw rate that was really sent. acceleration_rps2: bound of the vehicle's, as predicted.
    """
    acts_s = now_s + config.yaw_delay_s
    sent = (*(each for each in (state.sent if state else ()) if each[0] > now_s - _KEPT_S), last)
    own = own_heading(vehicle, sent, acts_s, config)
    heading_rad, rate_rps, steady_rps2 = *own, 0.0
    if state is not None and now_s - state.t_s <= _STALE_S:
        plan = state.heading_rad, state.rate_rps
        heading_rad, rate_rps = turned(plan, last[1] - state.correction_rps, now_s - state.t_s, config.yaw_lag_s)
        steady_rps2 = state.steady_rps2
    forward_rps = target.azimuth_rate_rps * fade(target.azimuth_rate_std_rps, config.feed_forward_std_rps)
    azimuth_rad = target.azimuth_rad + forward_rps * min(max(acts_s - target.t_s, -_MAX_AHEAD_S), _MAX_AHEAD_S)
    error_rad = wrap_pi(azimuth_rad - camera.mount_rpy_rad[2] - heading_rad)
    most_rps = config.max_yaw_rate_rps
    began_s = now_s if state is None else state.began_s
    if now_s - began_s < _GENTLE_S:
        most_rps, acceleration_rps2 = min(most_rps, _GENTLE_RPS), min(acceleration_rps2, _GENTLE_RPS2)
    heading_gain_ps = _between(_CALM_GAIN_PS, config.yaw_gain_ps, error_rad / _KNEE_RAD)
    closing_rps = _brakeable_rps(heading_gain_ps * error_rad, error_rad, config, acceleration_rps2)
    wanted_rps = _clip(forward_rps + closing_rps, most_rps)
    short_rps = wanted_rps - rate_rps
    gain_ps = max(_between(_CALM_RATE_GAIN_PS, _RATE_GAIN_PS, short_rps / _KNEE_RPS), _DAMPING * heading_gain_ps)
    turn_rps2 = _clip(steady_rps2 + gain_ps * short_rps, acceleration_rps2)
    lasting_rps2 = turn_rps2 if abs(turn_rps2) < _MAX_STEADY_RPS2 else 0.0
    steady_rps2 += (lasting_rps2 - steady_rps2) * TICK_S / _STEADY_S
    correction_rps = _HEADING_CORRECTION_PS * wrap_pi(heading_rad - own[0]) + _RATE_CORRECTION * (rate_rps - own[1])
    correction_rps = _clip(correction_rps, _MAX_CORRECTION_RPS)
    # The command under which a first-order lag has changed its rate by turn * tick when the tick is over.
    command_rps = rate_rps + turn_rps2 * TICK_S / -math.expm1(-TICK_S / config.yaw_lag_s) + correction_rps
    after = YawState(began_s, now_s, heading_rad, rate_rps, steady_rps2, correction_rps, sent)
    return _clip(command_rps, most_rps), after


def own_heading(vehicle: VehicleState, sent: tuple[Sent, ...], t_s: float, config: FollowConfig) -> Heading:
    """Heading and yaw rate of the vehicle at t_s, from its newest attitude and what it was told since."""
    heading = vehicle.yaw_rad, vehicle.yaw_rate_rps
    if vehicle.attitude_t_s is None:
        return heading
    at_s = max(vehicle.attitude_t_s, t_s - _MAX_AHEAD_S)
    acting_rps = vehicle.yaw_rate_rps
    for sent_s, rate_rps in sent:
        begins_s = min(sent_s + config.yaw_delay_s, t_s)
        if begins_s > at_s:
            heading, at_s = turned(heading, acting_rps, begins_s - at_s, config.yaw_lag_s), begins_s
        acting_rps = rate_rps
    return turned(heading, acting_rps, max(t_s - at_s, 0.0), config.yaw_lag_s)


def turned(heading: Heading, command_rps: float, dt_s: float, lag_s: float) -> Heading:
    """Heading and rate after dt_s under a constant command: a first-order lag."""
    heading_rad, rate_rps = heading
    left = math.exp(-dt_s / lag_s)
    over_rps = rate_rps - command_rps
    return heading_rad + command_rps * dt_s + over_rps * lag_s * (1 - left), command_rps + over_rps * left


def _brakeable_rps(rate_rps: float, error_rad: float, config: FollowConfig, acceleration_rps2: float) -> float:
    """The rate at which the error is closed, but no more than can be braked before it is gone."""
    linear_rad = acceleration_rps2 / config.yaw_gain_ps**2  # up to here the gain itself brakes within the acceleration
    left_rad = abs(error_rad) - linear_rad / 2
    return rate_rps if left_rad < linear_rad / 2 else _clip(rate_rps, math.sqrt(2 * acceleration_rps2 * left_rad))


def _between(low: float, high: float, knees: float) -> float:
    """From low to high (or high where that is less), half way at one knee."""
    low = min(low, high)
    return low + (high - low) * knees * knees / (knees * knees + 1)


def _clip(value: float, most: float) -> float:
    return min(max(value, -most), most)

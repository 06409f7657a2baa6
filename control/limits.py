"""Shaping of what is sent: acceleration, jerk and the slope of the yaw rate. Pure: the state goes in and comes out."""

from __future__ import annotations

import math
from dataclasses import dataclass

from control.config import ShapingConfig
from control.gate_limits import TICK_S
from control.types import Vec3, VelocityRequest

_REST: Vec3 = (0.0, 0.0, 0.0)
_STALE_S = 0.2  # after a gap this long shaping starts from rest again, as the gate does


@dataclass(frozen=True, slots=True)
class ShapeState:
    """What was requested last: velocity and acceleration in NED, yaw rate clockwise from above."""

    t_s: float
    velocity_ned_mps: Vec3 = _REST
    acceleration_ned_mps2: Vec3 = _REST
    yaw_rate_rps: float = 0.0


@dataclass(frozen=True, slots=True)
class Wish:
    """What a law would like, before shaping.

    brake: use the braking limits and forget the picture. Acceleration along `sight_ne` (unit, north and
    east) is kept within sight_acceleration_mps2 (low, high), so that the pitch keeps the target in view.
    """

    velocity_ned_mps: Vec3
    yaw_rate_rps: float
    brake: bool = False
    sight_ne: tuple[float, float] = (1.0, 0.0)
    sight_acceleration_mps2: tuple[float, float] = (-math.inf, math.inf)
    limited_by: tuple[str, ...] = ()


def zero_request(now_s: float) -> VelocityRequest:
    """The deliberate stop: the gate passes it in one step."""
    return VelocityRequest(now_s, _REST, 0.0)


def priming_request(now_s: float) -> VelocityRequest:
    """A zero for the moments before the vehicle takes up external control."""
    return VelocityRequest(now_s, _REST, 0.0, priming=True)


def after_setpoint(state: ShapeState, velocity_ned_mps: Vec3, yaw_rate_rps: float) -> ShapeState:
    """The state once the gate has sent this: where it trimmed, shaping goes on from what was really sent."""
    if (velocity_ned_mps, yaw_rate_rps) == (state.velocity_ned_mps, state.yaw_rate_rps):
        return state
    return ShapeState(state.t_s, velocity_ned_mps, _REST, yaw_rate_rps)


def shape(
    state: ShapeState, wish: Wish, now_s: float, config: ShapingConfig
) -> tuple[VelocityRequest, ShapeState, tuple[str, ...]]:
    """The nearest request to the wish that the limits allow now, the state after it, the limits that clip."""
    dt_s = min(max(now_s - state.t_s, 0.0), 2 * TICK_S)
    if now_s - state.t_s > _STALE_S:
        state, dt_s = ShapeState(now_s), TICK_S
    velocity, acceleration, names = _shape_velocity(state, wish, dt_s, config)
    step_rps = config.yaw_slope_rps2 * dt_s
    change_rps = wish.yaw_rate_rps - state.yaw_rate_rps
    if abs(change_rps) > step_rps:
        change_rps = math.copysign(step_rps, change_rps)
        names = (*names, "yaw rate slope")
    yaw_rate_rps = state.yaw_rate_rps + change_rps
    clipping = (*wish.limited_by, *names)
    request = VelocityRequest(now_s, velocity, yaw_rate_rps, clipping)
    return request, ShapeState(now_s, velocity, acceleration, yaw_rate_rps), clipping


def _shape_velocity(
    state: ShapeState, wish: Wish, dt_s: float, config: ShapingConfig
) -> tuple[Vec3, Vec3, tuple[str, ...]]:
    error = _sub(wish.velocity_ned_mps, state.velocity_ned_mps)
    size = _norm(error)
    top = config.braking_mps2 if wish.brake else config.acceleration_mps2
    jerk = config.braking_jerk_mps3 if wish.brake else config.jerk_mps3
    if dt_s <= 0:
        return state.velocity_ned_mps, state.acceleration_ned_mps2, ()
    if size <= jerk * dt_s**2 and _norm(state.acceleration_ned_mps2) <= jerk * dt_s:
        return wish.velocity_ned_mps, _REST, ()
    # Braking curve of the jerk limit: from acceleration a the error still grows by a² / (2 jerk).
    aim = min(top, math.sqrt(2 * jerk * size), size / dt_s)
    wanted = _scale(error, aim / size) if size > 0 else _REST
    names: list[str] = ["acceleration"] if aim == top else []
    if not wish.brake:
        wanted, in_view = _keep_in_view(wanted, wish)
        names += [] if in_view else ["field of view"]
    change = _sub(wanted, state.acceleration_ned_mps2)
    if _norm(change) > jerk * dt_s:
        change = _scale(change, jerk * dt_s / _norm(change))
        names.append("jerk")
    acceleration = _add(state.acceleration_ned_mps2, change)
    if _norm(acceleration) > top:
        acceleration = _scale(acceleration, top / _norm(acceleration))
    return _add(state.velocity_ned_mps, _scale(acceleration, dt_s)), acceleration, tuple(names)


def _keep_in_view(acceleration: Vec3, wish: Wish) -> tuple[Vec3, bool]:
    north, east = wish.sight_ne
    along = acceleration[0] * north + acceleration[1] * east
    low, high = wish.sight_acceleration_mps2
    excess = along - min(max(along, low), high)
    kept = (acceleration[0] - excess * north, acceleration[1] - excess * east, acceleration[2])
    return kept, excess == 0


def _norm(v: Vec3) -> float:
    return math.hypot(*v)


def _scale(v: Vec3, k: float) -> Vec3:
    return v[0] * k, v[1] * k, v[2] * k


def _add(a: Vec3, b: Vec3) -> Vec3:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _sub(a: Vec3, b: Vec3) -> Vec3:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]

"""The last word before the wire: the only maker of a Setpoint. Standard library only, trusts nobody.

Two promises hold for any input. One: every Setpoint is finite and within `Limits`. Two: a Setpoint is
either exactly zero or differs from the previous one by at most max_acceleration * dt in velocity and
max_yaw_acceleration * dt in yaw rate. Exactly zero is always reachable in one step: stopping at once
bounds every fault by one tick, and the autopilot smooths the braking. What was stopped restarts from zero.

None (send nothing) where the vehicle is not ours or not known to be; zero where it is ours but flying on
would be blind. Only a zero marked `priming` may leave before the vehicle is in EXTERNAL, and only in HOLD.
"""

from __future__ import annotations

import math
from dataclasses import InitVar, dataclass
from typing import Final

from control.checks import finite, fresh, vector
from control.gate_limits import TICK_S, Bound, Limits, bounds, height_bounds, kept, outside
from control.types import Reason, Vec3, VehicleMode, VehicleState, VelocityRequest

__all__ = ["TICK_S", "Limits", "Reason", "Setpoint", "gate"]

_TOKEN: Final = object()
_REST: Final = (0.0, 0.0, 0.0, 0.0)
Motion = tuple[float, float, float, float]  # north, east, down (m/s), yaw rate (rad/s)


@dataclass(frozen=True, slots=True)
class Setpoint:
    """Velocity (NED, m/s) and yaw rate (rad/s, clockwise from above) that may go on the wire, once."""

    t_s: float
    velocity_ned_mps: Vec3
    yaw_rate_rps: float
    token: InitVar[object]

    def __post_init__(self, token: object) -> None:
        if token is not _TOKEN:
            raise TypeError("only control.gate.gate makes a Setpoint")

    def __init_subclass__(cls) -> None:
        raise TypeError("nothing else is a Setpoint")

    def __reduce__(self) -> str:
        raise TypeError("a Setpoint is sent once, and neither copied nor stored")


def gate(
    request: VelocityRequest | None,
    vehicle: VehicleState,
    now_s: float,
    previous: Setpoint | None,
    limits: Limits,
) -> tuple[Setpoint | None, Reason]:
    """What to send now (None = nothing) and why; `previous` is what this returned last. Never raises."""
    silent = _why_silent(request, vehicle, now_s, limits)
    if silent is not None or request is None:
        return None, silent or Reason.NO_REQUEST
    stop = _why_zero(request, vehicle, now_s, previous, limits)
    motion, reason = (_REST, stop) if stop is not None else _shape(request, vehicle, now_s, previous, limits)
    return Setpoint(now_s, motion[:3], motion[3], _TOKEN), reason


def _shape(
    request: VelocityRequest, vehicle: VehicleState, now_s: float, previous: Setpoint | None, limits: Limits
) -> tuple[Motion, Reason]:
    """Clip, then slew. Both ends of the slew are clipped, so in one convex set: so is all between them."""
    near = bounds(vehicle, limits)
    wanted, reason = _clip((*request.velocity_ned_mps, request.yaw_rate_rps), vehicle, near, limits)
    if wanted == _REST:
        return _REST, reason
    last = (*previous.velocity_ned_mps, previous.yaw_rate_rps) if type(previous) is Setpoint else _REST
    dt_s = min(max(now_s - previous.t_s, 0.0), 2 * TICK_S) if type(previous) is Setpoint else TICK_S
    start, _ = _clip(last, vehicle, near, limits)
    left_mps = limits.max_acceleration_mps2 * dt_s - math.dist(start[:3], last[:3])
    left_rps = limits.max_yaw_acceleration_rps2 * dt_s - abs(start[3] - last[3])
    if left_mps < 0 or left_rps < 0:
        return _REST, Reason.LIMIT_JUMPED
    k = min(1.0, left_mps / max(math.dist(wanted[:3], start[:3]), 1e-9))
    yaw = start[3] + min(max(wanted[3] - start[3], -left_rps), left_rps)
    north, east, down = (start[i] + k * (wanted[i] - start[i]) for i in range(3))
    return (north, east, down, yaw), Reason.SLEW if k < 1.0 or yaw != wanted[3] else reason


def _why_silent(request: object, vehicle: object, now_s: object, limits: object) -> Reason | None:
    if not (type(vehicle) is VehicleState and type(limits) is Limits and finite(now_s)):
        return Reason.BAD_CALL
    if type(request) is not VelocityRequest:
        return Reason.NO_REQUEST
    if not all(fresh(t, now_s, limits.heartbeat_age_s) for t in (vehicle.heartbeat_t_s, vehicle.mode_t_s)):
        return Reason.HEARTBEAT_STALE
    priming = request.priming is True and vehicle.mode is VehicleMode.HOLD
    if vehicle.mode is not VehicleMode.EXTERNAL and not priming:
        return Reason.NOT_OURS
    if vehicle.failsafe is not False:
        return Reason.FAILSAFE
    return None if vehicle.armed is True else Reason.NOT_ARMED


def _why_zero(
    request: VelocityRequest, vehicle: VehicleState, now_s: float, previous: object, limits: Limits
) -> Reason | None:
    if request.priming is not False:
        return Reason.PRIMING
    if not fresh(request.t_s, now_s, limits.request_age_s):
        return Reason.REQUEST_STALE
    if not (vector(request.velocity_ned_mps) and finite(request.yaw_rate_rps)):
        return Reason.REQUEST_INVALID
    stamps = (vehicle.attitude_t_s, vehicle.position_t_s)
    if not all(fresh(t, now_s, limits.telemetry_age_s) for t in stamps):
        return Reason.TELEMETRY_STALE
    if not (vector(vehicle.position_ned_m) and vector(vehicle.velocity_ned_mps) and finite(vehicle.height_m)):
        return Reason.TELEMETRY_STALE
    if outside(vehicle.position_ned_m, vehicle.height_m, limits):
        return Reason.AT_FENCE
    if type(previous) is Setpoint and not fresh(previous.t_s, now_s, limits.request_age_s):
        return Reason.GAP
    return None


def _clip(motion: Motion, vehicle: VehicleState, near: list[Bound], limits: Limits) -> tuple[Motion, Reason]:
    """Into the speed, height and fence limits, each a convex set with zero in it; the last trim is named."""
    north, east, down, yaw = motion
    scale = min(1.0, limits.max_speed_mps / max(math.hypot(north, east), 1e-9))
    north, east = north * scale, east * scale
    down = min(max(down, -limits.max_climb_mps), limits.max_descent_mps)
    yaw = min(max(yaw, -limits.max_yaw_rate_rps), limits.max_yaw_rate_rps)
    reason = Reason.PASSED if (north, east, down, yaw) == motion else Reason.SPEED
    sink_mps, rise_mps = height_bounds(vehicle, limits)
    if not -rise_mps <= down <= sink_mps:
        down, reason = min(max(down, -rise_mps), sink_mps), Reason.ALTITUDE
    inside = kept(north, east, near)
    return (*inside, down, yaw), reason if inside == (north, east) else Reason.FENCE

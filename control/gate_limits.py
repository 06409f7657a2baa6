"""The ceilings no configuration can lift, and what they leave of a velocity. Standard library only."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from control.checks import check_ranges, ranged
from control.fence import Fence, walls
from control.types import Vec3, VehicleState

__all__ = ["TICK_S", "Bound", "Limits", "bounds", "height_bounds", "kept", "outside", "stoppable_mps"]

TICK_S: Final = 0.05
_ROUNDING_MPS: Final = 1e-9
_HEIGHT_SLACK_M: Final = 1.0  # so far past floor or ceiling is a nudge, to be flown back; further is outside

Bound = tuple[float, float, float]  # unit vector (north, east) and how fast (m/s) one may fly that way, 0 or more


@dataclass(frozen=True, slots=True)
class Limits:
    """What may leave the gate: defaults, and in each field the range that configuration may choose from.

    ValueError names field, range and value.
    """

    max_speed_mps: float = ranged(0.1, 8.0, 12.0)
    max_climb_mps: float = ranged(0.0, 2.0, 3.0)
    max_descent_mps: float = ranged(0.0, 1.0, 1.5)
    max_yaw_rate_rps: float = ranged(0.0, math.radians(90), math.radians(90))
    max_acceleration_mps2: float = ranged(0.5, 4.0, 5.0)
    # Slope of the yaw rate asked for. The vehicle's own yaw loop smooths it and a yaw rate moves it nowhere, so this
    # only keeps a command from jumping from one end to the other within a tick.
    max_yaw_acceleration_rps2: float = ranged(0.1, math.radians(1100), math.radians(1200))
    response_s: float = ranged(0.5, 0.9, 3.0)  # link and vehicle, for the stopping distance
    braking_mps2: float = ranged(0.2, 2.0, 2.5)
    request_age_s: float = ranged(0.05, 0.2, 0.2)
    telemetry_age_s: float = ranged(0.1, 0.5, 0.5)
    heartbeat_age_s: float = ranged(1.1, 3.0, 3.0)
    fence: Fence = field(default_factory=Fence)

    def __post_init__(self) -> None:
        check_ranges(self)
        if type(self.fence) is not Fence:
            raise ValueError(f"fence must be a Fence, not {self.fence!r}")


def outside(position_ned_m: Vec3, height_m: float, limits: Limits) -> bool:
    """Whether the vehicle is nearer to a side of the fence than its margin, or beyond it: stop and hold."""
    fence = limits.fence
    if not fence.min_height_m - _HEIGHT_SLACK_M <= height_m <= fence.max_height_m + _HEIGHT_SLACK_M:
        return True
    return min(distance_m for _, _, distance_m in walls(fence, *position_ned_m[:2])) < fence.margin_m


def bounds(vehicle: VehicleState, limits: Limits) -> list[Bound]:
    """How fast one may fly towards each wall of the fence that matters, and still stop before it.

    Whatever is sent now acts late: until then the vehicle flies on as it does, wind and all. And what flies fast
    along a wall takes long to stop: so long it keeps a part of the speed that it has towards the wall.
    """
    north_mps, east_mps, _ = vehicle.velocity_ned_mps
    stop_s = limits.response_s + math.hypot(north_mps, east_mps) / (2 * limits.braking_mps2)
    full_stop_s = limits.response_s + limits.max_speed_mps / (2 * limits.braking_mps2)
    reach_m = limits.max_speed_mps * max(stop_s, full_stop_s)
    found = []
    for n, e, distance_m in walls(limits.fence, *vehicle.position_ned_m[:2]):
        left_m = distance_m - max(n * north_mps + e * east_mps, 0.0) * limits.response_s
        if left_m < reach_m:
            found.append((n, e, min(stoppable_mps(left_m, limits), max(left_m, 0.0) / stop_s)))
    return found


def height_bounds(vehicle: VehicleState, limits: Limits) -> tuple[float, float]:
    """How fast one may sink and climb (m/s) and still stop at floor and ceiling."""
    down_mps, fence = vehicle.velocity_ned_mps[2], limits.fence
    below_m = vehicle.height_m - fence.min_height_m - max(down_mps, 0.0) * limits.response_s
    above_m = fence.max_height_m - vehicle.height_m - max(-down_mps, 0.0) * limits.response_s
    return stoppable_mps(below_m, limits), stoppable_mps(above_m, limits)


def kept(north_mps: float, east_mps: float, near: list[Bound]) -> tuple[float, float]:
    """The velocity, less what runs at a wall too fast. What may stay is a convex set with zero in it."""
    for n, e, most_mps in near:
        excess_mps = max(n * north_mps + e * east_mps - most_mps, 0.0)
        north_mps, east_mps = north_mps - excess_mps * n, east_mps - excess_mps * e
    # What was taken away at one wall may push at another: then slower, until no wall is run at.
    scale = 1.0
    for n, e, most_mps in near:
        towards_mps = n * north_mps + e * east_mps
        if towards_mps > most_mps + _ROUNDING_MPS:
            scale = min(scale, most_mps / towards_mps)
    return north_mps * scale, east_mps * scale


def stoppable_mps(margin_m: float, limits: Limits) -> float:
    """The speed v whose stopping distance v * response + v² / (2 * braking) is the margin; 0 beyond it."""
    a, t = limits.braking_mps2, limits.response_s
    return a * (math.sqrt(t * t + 2 * max(margin_m, 0.0) / a) - t)

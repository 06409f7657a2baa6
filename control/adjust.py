"""What an operator may change while following: another mode, another standoff. Each begins from this moment."""

from __future__ import annotations

from dataclasses import replace

from control.config import FollowConfig
from control.modes import Confirmation, ConfirmError, FollowMode, check_distance, confirm
from control.types import TargetState, Vec3, VehicleState


def change_mode(
    confirmation: Confirmation,
    mode: FollowMode,
    target: TargetState,
    vehicle: VehicleState,
    now_s: float,
    config: FollowConfig,
    *,
    distance_m: float | None = None,
) -> Confirmation:
    """The same follow in another mode; what is known of distance and height is kept. ConfirmError as `confirm`.

    The new mode's reference is fresh: the bearing of now, and the place where the vehicle can have stopped. Coming
    from spotlight, which needs no distance, that is found as at a confirmation; distance_m (m): typed.
    """
    if mode.holds_distance and not confirmation.mode.holds_distance:
        fresh = confirm(mode, target, vehicle, now_s, config, distance_m=distance_m)
        return replace(fresh, height_m=confirmation.height_m)
    place = _stopping_place_ned_m(vehicle, config)
    return replace(
        confirmation, mode=mode, t_s=now_s, azimuth_rad=target.azimuth_rad, position_ned_m=place, standoff_goal_m=None
    )


def change_standoff(confirmation: Confirmation, standoff_m: float, config: FollowConfig) -> Confirmation:
    """The same follow on its way to another ground distance (m). ConfirmError where that may not be held."""
    if not confirmation.mode.holds_distance:
        raise ConfirmError(f"{confirmation.mode.value} holds no distance")
    check_distance("standoff", standoff_m, config)
    return replace(confirmation, standoff_goal_m=standoff_m)


def _stopping_place_ned_m(vehicle: VehicleState, config: FollowConfig) -> Vec3:
    """Where it comes to rest if it brakes now: spotlight need not fly back there."""
    (north, east, down), (vn, ve, _) = vehicle.position_ned_m, vehicle.velocity_ned_mps
    coast_s = config.response_s + (vn**2 + ve**2) ** 0.5 / (2 * config.braking_mps2)
    return north + vn * coast_s, east + ve * coast_s, down

"""The vertical part of every mode: the height of the confirmation, or that above the target (FollowConfig.altitude)."""

from __future__ import annotations

import math

from control.config import FollowConfig
from control.modes import Confirmation
from control.motion import range_m
from control.types import TargetState, Vec3, VehicleState


def vertical_mps(
    confirmation: Confirmation,
    target: TargetState,
    vehicle: VehicleState,
    own_velocity_ned_mps: Vec3,
    config: FollowConfig,
    *,
    sure: bool,
) -> float:
    """Velocity down (m/s). own_velocity_ned_mps: as late as the filter's rates. sure: the target is seen, and whole.

    Relative: the target's height comes from the slant range, which is from its size, and the elevation; what of
    it changes is fed forward. A guess moves nothing: unless sure, the vehicle does not climb or sink after it.
    """
    if confirmation.above_m is None:
        return _bounded(config.height_gain_ps * (vehicle.height_m - confirmation.height_m), config)
    if not sure:
        return 0.0
    slant_m = range_m(confirmation, target)
    sine, cosine = math.sin(target.elevation_rad), math.cos(target.elevation_rad)
    error_m = slant_m * sine + confirmation.above_m  # how far the vehicle is too low
    rising_mps = slant_m * (cosine * target.elevation_rate_rps - sine * target.log_size_rate_ps)
    rising_mps -= own_velocity_ned_mps[2]
    return _bounded(-config.height_gain_ps * error_m - config.target_velocity_gain * rising_mps, config)


def _bounded(down_mps: float, config: FollowConfig) -> float:
    return min(max(down_mps, -config.max_vertical_mps), config.max_vertical_mps)

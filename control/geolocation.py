"""Where the target is on the earth: from the filtered line of sight and its distance. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from control.checks import vector
from control.fence import Point
from control.motion import TargetMotion
from control.types import TargetState, Vec3, VehicleState

# WGS84: equatorial radius (m) and first eccentricity squared.
_RADIUS_M: Final = 6_378_137.0
_ECCENTRICITY2: Final = 6.694_379_990_14e-3


@dataclass(frozen=True, slots=True)
class TargetFix:
    """The target at t_s. offset_ned_m: from the vehicle. velocity_ned_mps: over ground.

    std_ned_m: standard deviations of the offset, taken along the axes.
    """

    t_s: float
    offset_ned_m: Vec3
    velocity_ned_mps: Vec3
    std_ned_m: Vec3


def target_fix(target: TargetState, motion: TargetMotion) -> TargetFix | None:
    """The line of sight, made as long as the follow law believes it to be; None where that is no number.

    The target moves on level ground: its velocity down is taken to be zero. Spread: bearing's and elevation's
    times the distance across the line of sight, the size's along it.
    """
    distance, (c, s) = motion.distance_m, (math.cos(target.azimuth_rad), math.sin(target.azimuth_rad))
    slope = math.tan(target.elevation_rad)
    offset = (distance * c, distance * s, -distance * slope)
    radial, tangential = motion.radial_mps, motion.tangential_mps
    velocity = (radial * c - tangential * s, radial * s + tangential * c, 0.0)
    along_m, across_m = distance * target.log_size_std, distance * target.azimuth_std_rad
    rise_m = distance * target.elevation_std_rad / math.cos(target.elevation_rad) ** 2
    std = (
        math.hypot(along_m * c, across_m * s),
        math.hypot(along_m * s, across_m * c),
        math.hypot(along_m * slope, rise_m),
    )
    fix = TargetFix(target.t_s, offset, velocity, std)
    return fix if vector(offset) and vector(velocity) and vector(std) else None


def from_home(fix: TargetFix, vehicle: VehicleState, now_s: float) -> Vec3:
    """The target in NED metres from home; the vehicle's place is carried on from when it was heard to now."""
    age_s = 0.0 if vehicle.position_t_s is None else now_s - vehicle.position_t_s
    north, east, down = (
        place + speed * age_s + offset
        for place, speed, offset in zip(vehicle.position_ned_m, vehicle.velocity_ned_mps, fix.offset_ned_m, strict=True)
    )
    return north, east, down


def moved_deg(place_deg: Point, north_m: float, east_m: float) -> Point:
    """Latitude and longitude (deg) so many metres from a place, up to some km, not at the poles.

    Flat earth with WGS84's radii of curvature at the place: within 0.1 m for 500 m below 65 degrees of latitude.
    """
    latitude_rad = math.radians(place_deg[0])
    w2 = 1.0 - _ECCENTRICITY2 * math.sin(latitude_rad) ** 2
    across_m = _RADIUS_M / math.sqrt(w2)
    along_m = across_m * (1.0 - _ECCENTRICITY2) / w2
    latitude = place_deg[0] + math.degrees(north_m / along_m)
    longitude = place_deg[1] + math.degrees(east_m / (across_m * math.cos(latitude_rad)))
    return latitude, (longitude + 180.0) % 360.0 - 180.0

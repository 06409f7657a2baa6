"""Where the target is on the earth: from the filtered line of sight and its distance. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from control.checks import vector
from control.fence import Point
from control.types import TargetState, Vec3

# WGS84: equatorial radius (m) and first eccentricity squared.
_RADIUS_M: Final = 6_378_137.0
_ECCENTRICITY2: Final = 6.694_379_990_14e-3
_TIME_CONSTANT_S: Final = 0.3


@dataclass(frozen=True, slots=True)
class TargetFix:
    """The target at t_s. offset_ned_m: from the vehicle. velocity_ned_mps: over ground.

    std_ned_m: standard deviations of the offset, taken along the axes.
    """

    t_s: float
    offset_ned_m: Vec3
    velocity_ned_mps: Vec3
    std_ned_m: Vec3


def target_fix(
    target: TargetState, distance_m: float, radial_mps: float = 0.0, tangential_mps: float = 0.0
) -> TargetFix | None:
    """The line of sight to a ground distance, as the follow law believes it; None where that is no number.

    The target moves on level ground: its velocity down is taken to be zero. Spread: bearing's and elevation's
    times the distance across the line of sight, the size's along it.
    """
    c, s = math.cos(target.azimuth_rad), math.sin(target.azimuth_rad)
    slope = math.tan(target.elevation_rad)
    offset = (distance_m * c, distance_m * s, -distance_m * slope)
    velocity = (radial_mps * c - tangential_mps * s, radial_mps * s + tangential_mps * c, 0.0)
    along_m, across_m = distance_m * target.log_size_std, distance_m * target.azimuth_std_rad
    rise_m = distance_m * target.elevation_std_rad / math.cos(target.elevation_rad) ** 2
    std = (
        math.hypot(along_m * c, across_m * s),
        math.hypot(along_m * s, across_m * c),
        math.hypot(along_m * slope, rise_m),
    )
    fix = TargetFix(target.t_s, offset, velocity, std)
    return fix if vector(offset) and vector(velocity) and vector(std) else None


def offset_from_m(place_deg: Point, origin_deg: Point) -> Point:
    """North and east (m) of an origin, both as latitude and longitude (deg), up to some km, not at the poles.

    Flat earth with WGS84's radii of curvature at the origin: within 0.1 m for 500 m below 65 degrees of latitude.
    """
    along_m, across_m = _per_radian_m(origin_deg[0])
    east_deg = (place_deg[1] - origin_deg[1] + 180.0) % 360.0 - 180.0
    return math.radians(place_deg[0] - origin_deg[0]) * along_m, math.radians(east_deg) * across_m


def moved_deg(origin_deg: Point, offset_m: Point) -> Point:
    """The way back: latitude and longitude (deg) of what lies so far north and east (m) of an origin."""
    along_m, across_m = _per_radian_m(origin_deg[0])
    longitude_deg = origin_deg[1] + math.degrees(offset_m[1] / across_m)
    return origin_deg[0] + math.degrees(offset_m[0] / along_m), (longitude_deg + 180.0) % 360.0 - 180.0


def _per_radian_m(latitude_deg: float) -> Point:
    """Metres in one radian of latitude and of longitude."""
    latitude_rad = math.radians(latitude_deg)
    w2 = 1.0 - _ECCENTRICITY2 * math.sin(latitude_rad) ** 2
    across_m = _RADIUS_M / math.sqrt(w2)
    return across_m * (1.0 - _ECCENTRICITY2) / w2, across_m * math.cos(latitude_rad)


@dataclass(frozen=True, slots=True)
class Aim:
    """The target as it is told to the vehicle, NED metres from any fixed origin; it never jumps.

    A critically damped alpha-beta filter over the places where it was seen. Its velocity does not, as the follow
    law's, contain the vehicle's own, which turns quickly where the vehicle's own mode takes it round the target.
    seen_velocity_ned_mps: when it was last seen; velocity_ned_mps: as told.
    """

    t_s: float
    position_ned_m: Vec3
    velocity_ned_mps: Vec3
    std_ned_m: Vec3
    seen_velocity_ned_mps: Vec3

    @classmethod
    def begin(cls, t_s: float, position_ned_m: Vec3, velocity_ned_mps: Vec3, std_ned_m: Vec3, most_mps: float) -> Aim:
        """The first of a follow; most_mps: it is told to be no faster."""
        velocity = _at_most(velocity_ned_mps, most_mps)
        return cls(t_s, position_ned_m, velocity, std_ned_m, velocity)

    def seen(self, t_s: float, position_ned_m: Vec3, std_ned_m: Vec3, most_mps: float) -> Aim:
        """It is seen there: what is told goes there, on level ground, at most_mps at the most."""
        dt_s = max(t_s - self.t_s, 1e-3)
        kept = math.exp(-dt_s / _TIME_CONSTANT_S)
        error = _minus(position_ned_m, _plus(self.position_ned_m, _times(self.seen_velocity_ned_mps, dt_s)))
        north, east, _ = _plus(self.seen_velocity_ned_mps, _times(error, (1.0 - kept) ** 2 / dt_s))
        step = _plus(_times(self.seen_velocity_ned_mps, dt_s), _times(error, 1.0 - kept**2))
        place = _plus(self.position_ned_m, _at_most(step, most_mps * dt_s))
        return Aim.begin(t_s, place, (north, east, 0.0), std_ned_m, most_mps)

    def fading(self, t_s: float, factor: float) -> Aim:
        """It is not seen: it goes on as it went, at so much of its speed; factor 0: it stands still."""
        velocity = _times(self.seen_velocity_ned_mps, factor)
        position = _plus(self.position_ned_m, _times(velocity, max(t_s - self.t_s, 0.0)))
        return replace(self, t_s=t_s, position_ned_m=position, velocity_ned_mps=velocity)


def _at_most(vector_: Vec3, most: float) -> Vec3:
    return _times(vector_, min(1.0, most / max(math.hypot(*vector_), 1e-9)))


def _plus(a: Vec3, b: Vec3) -> Vec3:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _minus(a: Vec3, b: Vec3) -> Vec3:
    return _plus(a, _times(b, -1.0))


def _times(a: Vec3, factor: float) -> Vec3:
    return a[0] * factor, a[1] * factor, a[2] * factor

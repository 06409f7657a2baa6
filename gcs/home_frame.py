"""Positions from home. The vehicle's local frame begins where it first knew its place, which need not be there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from control.fence import offset_m
from control.types import Vec3

_MOVED_M: Final = 2.0  # less is noise: local and global position are not of the same moment


@dataclass(frozen=True, slots=True)
class Home:
    """HOME_POSITION: degrees, and metres above mean sea level."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


@dataclass(frozen=True, slots=True)
class VehiclePlace:
    """GLOBAL_POSITION_INT, heard at t_s: degrees, and metres above mean sea level."""

    t_s: float
    latitude_deg: float
    longitude_deg: float
    altitude_m: float

    @property
    def deg(self) -> tuple[float, float]:
        """Latitude and longitude."""
        return self.latitude_deg, self.longitude_deg


class HomeFrame:
    """Where home lies in the local frame; once known it stays, unless home is moved on the ground."""

    def __init__(self) -> None:
        self.home: Home | None = None  # the one that positions are counted from
        self._ne_m = (0.0, 0.0)

    def heard(self, home: Home, place_deg: tuple[float, float], local_ned_m: Vec3, *, in_air: bool) -> None:
        """The vehicle says where home is, and where it is itself in degrees and in its local frame."""
        if place_deg == (0.0, 0.0) or (in_air and self.home is not None):
            return
        north_m, east_m = offset_m(place_deg, (home.latitude_deg, home.longitude_deg))
        ne_m = local_ned_m[0] - north_m, local_ned_m[1] - east_m
        if self.home is None or math.dist(ne_m, self._ne_m) > _MOVED_M:
            self.home, self._ne_m = home, ne_m

    def from_home(self, local_ned_m: Vec3) -> Vec3:
        """NED metres from home; as it is while home is unknown."""
        return local_ned_m[0] - self._ne_m[0], local_ned_m[1] - self._ne_m[1], local_ned_m[2]

"""Where following may fly: a circle, a polygon, a distance from the operator, a floor and a ceiling, all at once.

What is near is described by walls. A wall is a straight line with the vehicle on one side and a piece of the
fence on the other, and the walls together keep every piece of it out: whatever stops before each wall has
stopped inside the fence, however the fence is bent. A circle's walls are the sides of a polygon within it. A side
of the operator's polygon, which may be concave, is kept out by the wall through its nearest point, square to
the line of sight to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

from control.checks import check_ranges, finite, optional, ranged

Point = tuple[float, float]  # north, east of home, m; or latitude, longitude, deg
Wall = tuple[float, float, float]  # unit vector towards it (north, east), distance (m; below 0: it is behind us)

_SIDES: Final = 64  # of a circle: they lie within it, by 0.12 % of the radius at most
_INNER: Final = math.cos(math.pi / _SIDES)
_DIRECTIONS: Final = tuple(
    (math.cos(2 * math.pi * k / _SIDES), math.sin(2 * math.pi * k / _SIDES)) for k in range(_SIDES)
)
_EARTH_RADIUS_M: Final = 6_371_000.0  # as PX4 projects its own local frame
_FAR_M: Final = 20_000.0
_CORNERS: Final = range(3, 65)
_APART_M: Final = 0.1
_UNPLACED: Final = (1.0, 0.0, -_FAR_M)


@dataclass(frozen=True, slots=True)
class Fence:
    """Where following may fly: inside all of these. Metres north and east of home, heights above home.

    polygon_m: 3 to 64 corners [north, east]. polygon_deg: the same as [latitude, longitude]; until the vehicle
    has told its home, nothing may fly then. operator_distance_m: at most so far from the operator's place (EU open
    category, A1: 50). Nearer than margin_m to any side it stops and holds, and does not resume by itself.
    ValueError names field, range and value.
    """

    north_m: float = ranged(-10_000.0, 0.0, 10_000.0)
    east_m: float = ranged(-10_000.0, 0.0, 10_000.0)
    radius_m: float = ranged(5.0, 150.0, 500.0)
    polygon_m: tuple[Point, ...] = ()
    polygon_deg: tuple[Point, ...] = ()
    operator_north_m: float = ranged(-1000.0, 0.0, 1000.0)
    operator_east_m: float = ranged(-1000.0, 0.0, 1000.0)
    operator_distance_m: float | None = optional(10.0, 500.0)
    margin_m: float = ranged(1.0, 1.5, 10.0)
    min_height_m: float = ranged(1.5, 3.0, 120.0)
    max_height_m: float = ranged(1.5, 60.0, 120.0)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.min_height_m >= self.max_height_m:
            raise ValueError(f"min_height_m {self.min_height_m:g} must be below max_height_m {self.max_height_m:g}")
        if self.polygon_m and self.polygon_deg:
            raise ValueError("polygon_m and polygon_deg are two ways to say the same: give one of them")
        _check_corners("polygon_m", self.polygon_m, (_FAR_M, _FAR_M))
        _check_shape("polygon_m", self.polygon_m)
        _check_corners("polygon_deg", self.polygon_deg, (85.0, 180.0))
        _check_shape("polygon_deg", self._in_metres(self.polygon_deg[0]) if self.polygon_deg else ())

    def placed(self, latitude_deg: float, longitude_deg: float) -> Fence:
        """The same with polygon_deg, if given, in metres from this home. ValueError where it is too far from it."""
        home = (latitude_deg, longitude_deg)
        return replace(self, polygon_m=self._in_metres(home), polygon_deg=()) if self.polygon_deg else self

    def _in_metres(self, home: Point) -> tuple[Point, ...]:
        return tuple(offset_m(corner, home) for corner in self.polygon_deg)


def walls(fence: Fence, north_m: float, east_m: float) -> list[Wall]:
    """All walls as seen from this place. Outside the fence at least one distance is 0 or less."""
    found = _circle(fence.radius_m, north_m - fence.north_m, east_m - fence.east_m)
    if fence.operator_distance_m is not None:
        place = north_m - fence.operator_north_m, east_m - fence.operator_east_m
        found += _circle(fence.operator_distance_m, *place)
    if fence.polygon_m:
        found += _polygon(fence.polygon_m, north_m, east_m)
    return [*found, _UNPLACED] if fence.polygon_deg else found


def _circle(radius_m: float, north_m: float, east_m: float) -> list[Wall]:
    inner_m = radius_m * _INNER
    return [(n, e, inner_m - n * north_m - e * east_m) for n, e in _DIRECTIONS]


def _polygon(corners: tuple[Point, ...], north_m: float, east_m: float) -> list[Wall]:
    here, inside = (north_m, east_m), False
    found = []
    for a, b in _sides(corners):
        n, e = _nearest(here, a, b)
        distance_m = math.dist((n, e), here)
        if distance_m > 0:
            found.append(((n - north_m) / distance_m, (e - east_m) / distance_m, distance_m))
        else:
            found.append((1.0, 0.0, 0.0))
        # A ray to the north crosses an odd number of sides from inside, an even number from outside.
        if (a[1] > east_m) != (b[1] > east_m):
            inside ^= north_m < a[0] + (east_m - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
    return found if inside else [(n, e, -distance_m) for n, e, distance_m in found]


def _nearest(here: Point, a: Point, b: Point) -> Point:
    """The point of the side a-b that is nearest."""
    n, e = b[0] - a[0], b[1] - a[1]
    along = ((here[0] - a[0]) * n + (here[1] - a[1]) * e) / (n * n + e * e)
    along = min(max(along, 0.0), 1.0)
    return a[0] + along * n, a[1] + along * e


def _sides(corners: tuple[Point, ...]) -> list[tuple[Point, Point]]:
    return list(pairwise((*corners, *corners[:1])))


def _check_corners(name: str, corners: object, highest: Point) -> None:
    """ValueError where these are not corners at all; highest: what each of their two numbers may be, or minus it."""
    if corners == ():
        return
    if type(corners) is not tuple or len(corners) not in _CORNERS:
        count = len(corners) if isinstance(corners, tuple | list) else repr(corners)
        raise ValueError(f"{name} must have {_CORNERS[0]} to {_CORNERS[-1]} corners, not {count}")
    for number, corner in enumerate(corners, 1):
        if type(corner) is not tuple or len(corner) != 2 or not all(map(finite, corner)):
            raise ValueError(f"{name}: corner {number} must be two finite numbers, not {corner!r}")
        if abs(corner[0]) > highest[0] or abs(corner[1]) > highest[1]:
            raise ValueError(f"{name}: corner {number} must be within {highest[0]:g} and {highest[1]:g}: {corner!r}")


def _check_shape(name: str, corners: tuple[Point, ...]) -> None:
    """ValueError where the sides of a polygon, in metres, are no fence one can be inside of."""
    sides = _sides(corners)
    for j, (a, b) in enumerate(sides):
        if math.dist(a, b) < _APART_M:
            raise ValueError(f"{name}: corner {j + 1} and the next are the same place")
        if math.dist(a, corners[0]) > _FAR_M:
            raise ValueError(f"{name}: corner {j + 1} is more than {_FAR_M / 1000:g} km from corner 1")
    for j, (a, b) in enumerate(sides):
        for i, corner in enumerate(corners):
            if i not in (j, (j + 1) % len(corners)) and math.dist(corner, _nearest(corner, a, b)) < _APART_M:
                raise ValueError(f"{name}: corner {i + 1} lies on the side from corner {j + 1}")
        for i, (c, d) in enumerate(sides[:j]):
            if _turn(a, b, c) * _turn(a, b, d) < 0 and _turn(c, d, a) * _turn(c, d, b) < 0:
                raise ValueError(f"{name}: the sides from corner {i + 1} and from corner {j + 1} cross")


def _turn(a: Point, b: Point, c: Point) -> float:
    """Above 0 where a-b-c turns one way, below 0 the other."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def offset_m(place_deg: Point, home_deg: Point) -> Point:
    """North and east (m) of home of a place, both as latitude and longitude (deg)."""
    north_deg = place_deg[0] - home_deg[0]
    east_deg = (place_deg[1] - home_deg[1] + 180.0) % 360.0 - 180.0
    per_deg = math.radians(_EARTH_RADIUS_M)
    return north_deg * per_deg, east_deg * per_deg * math.cos(math.radians(home_deg[0]))

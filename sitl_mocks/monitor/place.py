"""Where the vehicle may be: circles, a polygon and heights (U7)."""

from __future__ import annotations

import math
from itertools import pairwise

from sitl_mocks.monitor.limits import MonitorLimits, Vec3

Point = tuple[float, float]


def why_outside(position_ned_m: Vec3, limits: MonitorLimits) -> str | None:
    """What is left by more than the margin, in words; None inside."""
    north, east, down = position_ned_m
    height_m, margin_m = -down, limits.margin_m
    distance_m = math.hypot(north, east)
    if limits.fence_radius_m is not None and distance_m > limits.fence_radius_m + margin_m:
        return f"{distance_m:.1f} m from home"
    if limits.operator_distance_max_m is not None:
        distance_m = math.dist((north, east), limits.operator_ned_m[:2])
        if distance_m > limits.operator_distance_max_m + margin_m:
            return f"{distance_m:.1f} m from the operator"
    if limits.fence_polygon_ned_m is not None:
        distance_m = distance_outside_m((north, east), limits.fence_polygon_ned_m)
        if distance_m > margin_m:
            return f"{distance_m:.1f} m outside the polygon"
    too_low = limits.height_min_m is not None and height_m < limits.height_min_m - margin_m
    too_high = limits.height_max_m is not None and height_m > limits.height_max_m + margin_m
    return f"{height_m:.1f} m high" if too_low or too_high else None


def distance_outside_m(point: Point, polygon: tuple[Point, ...]) -> float:
    """How far a point (north, east) in m is outside a polygon, zero inside. The last corner joins the first."""
    closed = (*polygon, polygon[0])
    if sum(_crosses(point, a, b) for a, b in pairwise(closed)) % 2:
        return 0.0
    return min(_to_side_m(point, a, b) for a, b in pairwise(closed))


def _crosses(point: Point, a: Point, b: Point) -> bool:
    """Whether a ray to the east from the point meets the side."""
    if (a[0] > point[0]) == (b[0] > point[0]):
        return False
    return point[1] < a[1] + (point[0] - a[0]) / (b[0] - a[0]) * (b[1] - a[1])


def _to_side_m(point: Point, a: Point, b: Point) -> float:
    side = (b[0] - a[0], b[1] - a[1])
    length2 = side[0] ** 2 + side[1] ** 2
    along = 0.0 if length2 == 0.0 else ((point[0] - a[0]) * side[0] + (point[1] - a[1]) * side[1]) / length2
    along = min(max(along, 0.0), 1.0)
    return math.dist(point, (a[0] + along * side[0], a[1] + along * side[1]))

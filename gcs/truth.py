"""What a flight is measured against, where the truth is known: the demo's and the scenarios'."""

from __future__ import annotations

import math

from control.attitude import wrap_pi
from control.types import Vec3
from tracker.box import Box

_MIN_IOU = 0.3


class Standing:
    """How vehicle and target stand to each other, NED metres; the camera's yaw in rad."""

    __slots__ = ()
    vehicle_ned_m: Vec3
    yaw_rad: float
    target_ned_m: Vec3

    @property
    def bearing_error_rad(self) -> float:
        """Azimuth of the target as seen from the vehicle, less the heading of its camera."""
        north, east = (self.target_ned_m[i] - self.vehicle_ned_m[i] for i in (0, 1))
        return wrap_pi(math.atan2(east, north) - self.yaw_rad)

    @property
    def distance_m(self) -> float:
        """Horizontal distance."""
        return math.dist(self.vehicle_ned_m[:2], self.target_ned_m[:2])


def is_on(box: Box, true: Box) -> bool:
    """Intersection over union above 0.3."""
    ax, ay, aw, ah = box.xywh
    bx, by, bw, bh = true.xywh
    width = min(ax + aw, bx + bw) - max(ax, bx)
    height = min(ay + ah, by + bh) - max(ay, by)
    overlap = max(width, 0.0) * max(height, 0.0)
    return overlap > _MIN_IOU * (aw * ah + bw * bh - overlap)

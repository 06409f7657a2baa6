"""The map's paths as ticks tell them: of a flight, of one that was recorded, or of a dry run."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from control.config import FollowConfig
from control.fence import Fence
from gcs.flight_view import target_distance_m
from gcs.operator.station import Point, Scene
from gcs.tick import Tick

_PATH_S: Final = 1.0
_PATH_POINTS: Final = 300


class MapPaths:
    """Give it every tick; where vehicle and target were, about a point a second."""

    def __init__(self, follow: FollowConfig) -> None:
        self._follow = follow
        self._vehicle: deque[Point] = deque(maxlen=_PATH_POINTS)
        self._target: deque[Point] = deque(maxlen=_PATH_POINTS)
        self._due_s = -math.inf

    def note(self, tick: Tick) -> None:
        """A point of the paths, if it is time for one."""
        if tick.t_s < self._due_s:
            return
        self._due_s = tick.t_s + _PATH_S
        if tick.inputs.vehicle.position_t_s is not None:
            self._vehicle.append(tick.inputs.vehicle.position_ned_m[:2])
        target_m = target_of(tick, self._follow)
        if target_m is not None:
            self._target.append(target_m)

    def scene(self, tick: Tick | None, fence: Fence | None) -> Scene:
        """The map as of this tick."""
        paths = tuple(self._vehicle), tuple(self._target)
        if tick is None:
            return Scene(None, 0.0, None, fence, *paths)
        vehicle = tick.inputs.vehicle
        place = vehicle.position_ned_m[:2] if vehicle.position_t_s is not None else None
        return Scene(place, vehicle.yaw_rad, target_of(tick, self._follow), fence, *paths)


def target_of(tick: Tick, follow: FollowConfig) -> Point | None:
    """Where the target was, north and east in m; None where that is not known."""
    target, inputs = tick.target, tick.inputs
    vehicle = inputs.vehicle
    if target is None or not inputs.selected or inputs.latency_s is None or vehicle.position_t_s is None:
        return None
    away_m = target_distance_m(target, vehicle, tick.held, follow)
    if away_m is None or not math.isfinite(away_m):
        return None
    north_m, east_m, _ = vehicle.position_ned_m
    return north_m + away_m * math.cos(target.azimuth_rad), east_m + away_m * math.sin(target.azimuth_rad)

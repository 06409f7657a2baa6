"""The map's paths as ticks tell them: of a flight as it was recorded, or of a dry run."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from control.config import FollowConfig
from control.fence import Fence
from control.modes import ground_distance_m
from control.motion import distance_m
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


def away_m(tick: Tick, follow: FollowConfig) -> float | None:
    """Ground distance of the target as of this tick; None where it is not known."""
    if tick.target is None or not tick.inputs.selected or tick.inputs.latency_s is None:
        return None
    found = distance_m(tick.held, tick.target) if tick.held is not None else None
    if found is None:
        found = ground_distance_m(tick.target, tick.inputs.vehicle, follow)
    return found if found is not None and math.isfinite(found) else None


def target_of(tick: Tick, follow: FollowConfig) -> Point | None:
    """Where the target was, north and east in m; None where that is not known."""
    distance = away_m(tick, follow)
    if distance is None or tick.target is None or tick.inputs.vehicle.position_t_s is None:
        return None
    north_m, east_m, _ = tick.inputs.vehicle.position_ned_m
    azimuth_rad = tick.target.azimuth_rad
    return north_m + distance * math.cos(azimuth_rad), east_m + distance * math.sin(azimuth_rad)

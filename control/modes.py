"""The ways of following, and what is remembered at the moment the operator confirms."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum

from control.config import Altitude, FollowConfig
from control.types import TargetState, Vec3, VehicleState

_STEEPEST_RAD = math.radians(85)
_SURE_DEPRESSION_FACTOR = 2.0  # times the least depression from which a distance is told at all


class FollowMode(Enum):
    """What the vehicle does once a follow is confirmed."""

    SPOTLIGHT = "spotlight"  # the nose keeps the target centred, the vehicle keeps its place
    FOLLOW = "follow"  # and distance and height are held while the target moves
    PARALLEL = "parallel"  # and the target is kept on the bearing it had at confirmation
    ORBIT = "orbit"  # and the vehicle circles it

    @property
    def holds_distance(self) -> bool:
        """Whether it needs to know the distance."""
        return self is not FollowMode.SPOTLIGHT


class ConfirmError(ValueError):
    """The follow cannot be confirmed; the message says why."""


@dataclass(frozen=True, slots=True)
class Confirmation:
    """What holds from the moment of confirmation on.

    range_m: slant range to the target when it had log_size, as best known by now; confirmed_range_m: as then.
    standoff_m: ground distance to hold; standoff_goal_m: where it is being led, None: nowhere. ground_factor: the
    distance confirmed over what height and depression of the box's middle said of it, so that what the operator
    typed on sloping ground is kept; None where the line of sight was too flat to tell, or where the target need not
    stand at home's height. azimuth_rad: of the target then. above_m: how far the vehicle was above it; None: the
    vehicle's own height_m above home is held.
    """

    mode: FollowMode
    t_s: float
    log_size: float
    range_m: float
    confirmed_range_m: float
    standoff_m: float
    height_m: float
    position_ned_m: Vec3
    ground_factor: float | None = None
    azimuth_rad: float = 0.0
    above_m: float | None = None
    standoff_goal_m: float | None = None

    def standoff_rate_mps(self, config: FollowConfig) -> float:
        """How fast the standoff is growing now."""
        if self.standoff_goal_m is None:
            return 0.0
        return math.copysign(config.standoff_speed_mps, self.standoff_goal_m - self.standoff_m)

    def led(self, dt_s: float, config: FollowConfig) -> Confirmation:
        """The same dt_s (s) later: the standoff nearer to its goal."""
        if self.standoff_goal_m is None:
            return self
        step_m = self.standoff_rate_mps(config) * dt_s
        if abs(self.standoff_goal_m - self.standoff_m) <= abs(step_m):
            return replace(self, standoff_m=self.standoff_goal_m, standoff_goal_m=None)
        return replace(self, standoff_m=self.standoff_m + step_m)


def ground_distance_m(target: TargetState, vehicle: VehicleState, config: FollowConfig) -> float | None:
    """From height above home and depression, for a target on level ground; None where that says nothing.

    The ray through the middle of the box meets the ground behind the target, that through its lower edge in
    front of it; halfway between them the error is within 10 % for people and cars, from any side.
    """
    centre_m = _centre_ground_m(target, vehicle, config)
    if centre_m is None or target.log_aspect is None:
        return centre_m
    box_height_rad = math.exp(min(target.log_size - target.log_aspect / 2, 0.0))
    return vehicle.height_m / math.tan(min(box_height_rad / 4 - target.elevation_rad, _STEEPEST_RAD))


def sure_ground_m(target: TargetState, vehicle: VehicleState, config: FollowConfig) -> float | None:
    """From depression alone, where it is steep enough to contradict the size; times ground_factor the true one."""
    if -target.elevation_rad < _SURE_DEPRESSION_FACTOR * config.min_depression_rad:
        return None
    return _centre_ground_m(target, vehicle, config)


def _centre_ground_m(target: TargetState, vehicle: VehicleState, config: FollowConfig) -> float | None:
    depression_rad = -target.elevation_rad
    if not (depression_rad >= config.min_depression_rad and vehicle.height_m > 0):
        return None
    return vehicle.height_m / math.tan(depression_rad)


def confirm(
    mode: FollowMode,
    target: TargetState,
    vehicle: VehicleState,
    now_s: float,
    config: FollowConfig,
    *,
    distance_m: float | None = None,
    standoff_m: float | None = None,
) -> Confirmation:
    """What to remember of this moment. ConfirmError where the distance is unknown or not allowed.

    distance_m: the ground distance now, typed by the operator; otherwise it comes from height and depression.
    standoff_m: the ground distance to hold, otherwise the present one. Spotlight needs neither.
    """
    distance = distance_m if distance_m is not None else ground_distance_m(target, vehicle, config)
    known = distance is not None
    if distance is None:
        if mode.holds_distance:
            raise ConfirmError("distance unknown: the target is not clearly below the horizon; type a distance")
        distance = config.max_distance_m
    standoff = standoff_m if standoff_m is not None else distance
    if mode.holds_distance:
        check_distance("distance", distance, config)
        check_distance("standoff", standoff, config)
    range_m = distance / max(math.cos(target.elevation_rad), 0.1)
    relative = known and config.altitude is Altitude.RELATIVE
    ground_m = None if relative else sure_ground_m(target, vehicle, config)
    return Confirmation(
        mode=mode,
        t_s=now_s,
        log_size=target.log_size,
        range_m=range_m,
        confirmed_range_m=range_m,
        standoff_m=standoff,
        height_m=vehicle.height_m,
        position_ned_m=vehicle.position_ned_m,
        ground_factor=None if ground_m is None else distance / ground_m,
        azimuth_rad=target.azimuth_rad,
        above_m=-range_m * math.sin(target.elevation_rad) if relative else None,
    )


def check_distance(name: str, value_m: float, config: FollowConfig) -> None:
    """ConfirmError where it is none that may be held."""
    low_m, high_m = config.min_distance_m * 1.2, config.max_distance_m
    if not low_m <= value_m <= high_m:
        raise ConfirmError(f"{name} must be from {low_m:g} to {high_m:g} m, not {value_m:.1f} m")

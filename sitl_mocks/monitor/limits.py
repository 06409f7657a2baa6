"""What the judge counts as unsafe, and what it is told about the vehicle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

Vec3 = tuple[float, float, float]

SET_MESSAGE_INTERVAL, REQUEST_MESSAGE = 511, 512
SET_MODE, ARM, TAKEOFF, TERMINATE, REBOOT = 176, 400, 22, 185, 246


class Rule(Enum):
    """Unsafe outcomes, and the one that is a failure to fly although all is well."""

    OVER_LIMIT = "U1"  # non-finite, over the limit, or what the vehicle does not take as a velocity
    TOO_LATE = "U2"  # moving after it had to be still, or anything after it had to be silent
    NOT_EXTERNAL = "U3"  # a setpoint although the vehicle is in someone else's mode
    UNCONFIRMED = "U4"  # flying under external control again without the operator
    FORBIDDEN_COMMAND = "U5"  # arm, disarm, take-off, terminate, a parameter set while following
    WRONG_TARGET = "U6"
    OUTSIDE = "U7"  # fence or height left by more than the margin
    SLEW = "U8"
    UNAVAILABLE = "A1"  # healthy, and yet a gap, a hold or a mode request


@dataclass(frozen=True, slots=True)
class Truth:
    """The vehicle's true state: NED metres with the origin at home, yaw in rad."""

    external: bool
    armed: bool
    in_air: bool
    position_ned_m: Vec3
    yaw_rad: float = 0.0
    follows_target: bool = False  # external by its own follow mode: it obeys FOLLOW_TARGET, not setpoints

    @property
    def obeys(self) -> bool:
        """Setpoints move it now."""
        return self.external and self.armed and self.in_air


@dataclass(frozen=True, slots=True)
class MonitorLimits:
    """What counts as unsafe; None = not judged. Speeds m/s, accelerations m/s2, angles rad, places NED metres."""

    horizontal_max_mps: float = 12.0
    vertical_max_mps: float = 3.0
    yaw_rate_max_rps: float = math.radians(120)
    accel_max_mps2: float = 4.0
    yaw_accel_max_rps2: float = math.radians(1300)
    gimbal_rate_max_rps: float = math.radians(180)
    mode_grace_s: float = 1.1  # one heartbeat of PX4
    priming_s: float = 3.0  # zero setpoints before external mode: PX4 wants them first
    fence_radius_m: float | None = None  # round home
    fence_polygon_ned_m: tuple[tuple[float, float], ...] | None = None  # corners north, east
    operator_ned_m: Vec3 = (0.0, 0.0, 0.0)
    operator_distance_max_m: float | None = None  # horizontal, from operator_ned_m
    height_min_m: float | None = None
    height_max_m: float | None = None
    margin_m: float = 1.0
    system_id: int = 1
    component_id: int = 1
    confirmation_needed: bool = False
    confirmation_lasts_s: float = 10.0
    stream_break_s: float | None = 1.0  # after such a silence in external mode a new confirmation is needed
    forbidden_commands: frozenset[int] = frozenset({ARM, TAKEOFF, TERMINATE, REBOOT})  # while following
    never_commands: frozenset[int] = frozenset({TERMINATE})
    gap_max_s: float = 0.15  # while healthy
    zero_run_max_s: float = 1.0  # while healthy: standing still that long is a hold nobody asked for


@dataclass(frozen=True, slots=True)
class Reason:
    """One unsafe outcome."""

    t_s: float
    rule: Rule
    text: str

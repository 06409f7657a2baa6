"""The vehicle's own follow modes: PX4's Follow-Me and ArduCopter's Follow, fed by FOLLOW_TARGET.

As read in their sources and documentation, simplified, not measured. Both carry a target on with its last velocity
for 3 s after it was last heard; then PX4 lets it stand where it was carried to, and ArduCopter stops.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, Final

from sitl_mocks.dynamics import Motion, MotionCommand, Vec3, wrap_pi
from sitl_mocks.vehicle.params import Parameters

TIMEOUT_S: Final = 3.0
_POSITION, _VELOCITY = 1, 2  # FOLLOW_TARGET.est_capabilities
_FACING_FROM_M: Final = 1.0


@dataclass(frozen=True, slots=True)
class Heard:
    """A target as published: NED metres from home, m/s."""

    t_s: float
    sender: int
    position_ned_m: Vec3
    velocity_ned_mps: Vec3


def parse_target(message: Any, position_ned_m: Vec3, now_s: float) -> Heard | None:
    """A FOLLOW_TARGET whose place has been put into NED; None where it gives no position."""
    if not message.est_capabilities & _POSITION or message.lat == message.lon == 0:
        return None
    velocity = tuple(message.vel) if message.est_capabilities & _VELOCITY else (0.0, 0.0, 0.0)
    return Heard(now_s, message.get_srcSystem(), position_ned_m, velocity)


@dataclass(slots=True)
class Follower(ABC):
    """`begin` when the mode begins, `hear` for each target, `guide` once a tick."""

    params: Parameters
    heard: Heard | None = None

    def hear(self, heard: Heard) -> None:
        """A target was published; in whatever mode."""
        self.heard = heard

    @abstractmethod
    def begin(self) -> None:
        """The mode begins."""

    @abstractmethod
    def guide(self, motion: Motion, now_s: float) -> MotionCommand | None:
        """What it flies; None: it holds its place."""


@dataclass(slots=True)
class FollowMe(Follower):
    """PX4. Keeps FLW_TGT_DST from the target at the angle FLW_TGT_FA to its course, at a height of its own."""

    _position: Vec3 | None = None
    _velocity: Vec3 = (0.0, 0.0, 0.0)
    _fused_t_s: float = -math.inf
    _tick_t_s: float = 0.0
    _angle_rad: float | None = None  # where it is, seen from the target

    def begin(self) -> None:
        """Its filter starts with the next target."""
        self._position, self._angle_rad, self.heard = None, None, None

    def hear(self, heard: Heard) -> None:
        """Velocity is taken up with each, position twice a second."""
        self.heard = heard
        if self._position is None:
            self._position, self._velocity, self._fused_t_s = heard.position_ned_m, heard.velocity_ned_mps, heard.t_s
            return
        self._velocity = _mixed(self._velocity, heard.velocity_ned_mps, 0.82)
        if heard.t_s - self._fused_t_s >= 0.5:
            self._position, self._fused_t_s = _mixed(self._position, heard.position_ned_m, 0.9), heard.t_s

    def guide(self, motion: Motion, now_s: float) -> MotionCommand | None:
        """Height first, then round the target to its side, facing it."""
        dt_s, self._tick_t_s = min(max(now_s - self._tick_t_s, 0.0), 0.1), now_s
        if self._position is None or self.heard is None:
            return None
        if now_s - self.heard.t_s > TIMEOUT_S:
            self._velocity = (0.0, 0.0, 0.0)
        north, east, down = target = _moved(self._position, self._velocity, dt_s)
        self._position = target
        angle_rad = self._turned(motion, target, dt_s)
        away_m = self.params["FLW_TGT_DST"]
        height_m = self.params["FLW_TGT_HT"] + (-down if self.params["FLW_TGT_ALT_M"] == 2 else 0.0)
        up_mps = _clamped(height_m + motion.position_ned_m[2], 3.0)
        yaw = _facing(motion, target)
        if abs(height_m + motion.position_ned_m[2]) > 3.0:
            return MotionCommand((0.0, 0.0, -up_mps), 0.0, yaw)
        place = (north + away_m * math.cos(angle_rad), east + away_m * math.sin(angle_rad))
        velocity = tuple(
            v + 0.95 * (wanted - at)
            for v, wanted, at in zip(self._velocity[:2], place, motion.position_ned_m[:2], strict=True)
        )
        n_mps, e_mps = _no_faster(velocity, self.params["MPC_XY_VEL_MAX"])
        return MotionCommand((n_mps, e_mps, -up_mps), 0.0, yaw)

    def _turned(self, motion: Motion, target: Vec3, dt_s: float) -> float:
        """It stays on its side of a target that stands; of one that walks it goes to the side it is told."""
        if self._angle_rad is None:
            north, east = (at - t for at, t in zip(motion.position_ned_m[:2], target[:2], strict=True))
            self._angle_rad = math.atan2(east, north)
        n_mps, e_mps, _ = self._velocity
        if math.hypot(n_mps, e_mps) >= 1.0:
            wanted_rad = math.atan2(e_mps, n_mps) + math.radians(self.params["FLW_TGT_FA"])
            most_rad = self.params["FLW_TGT_MAX_VEL"] / self.params["FLW_TGT_DST"] * dt_s
            self._angle_rad += min(max(wrap_pi(wanted_rad - self._angle_rad), -most_rad), most_rad)
        return self._angle_rad


@dataclass(slots=True)
class Follow(Follower):
    """ArduCopter. Keeps FOLL_OFS_X, Y, Z from the target; where all are zero, what they are when the mode begins."""

    _offset: Vec3 | None = field(default=None)

    def begin(self) -> None:
        """Offsets that were found are forgotten."""
        self._offset = None

    def hear(self, heard: Heard) -> None:
        """Only of FOLL_SYSID, unless that is 0."""
        wanted = int(self.params["FOLL_SYSID"])
        if self.params["FOLL_ENABLE"] == 1 and self.params["FOLL_OFS_TYPE"] == 0 and wanted in (0, heard.sender):
            self.heard = heard

    def guide(self, motion: Motion, now_s: float) -> MotionCommand | None:
        """To the place beside the target, at its velocity."""
        heard = self.heard
        if heard is None or now_s - heard.t_s > TIMEOUT_S:
            return None
        target = _moved(heard.position_ned_m, heard.velocity_ned_mps, now_s - heard.t_s)
        if math.dist(target, motion.position_ned_m) > self.params["FOLL_DIST_MAX"] > 0:
            return None
        offset = tuple(self.params[f"FOLL_OFS_{axis}"] for axis in "XYZ")
        if not any(offset):
            if self._offset is None:
                self._offset = _moved(motion.position_ned_m, target, -1.0)
            offset = self._offset
        error = tuple(t + o - at for t, o, at in zip(target, offset, motion.position_ned_m, strict=True))
        distance_m = math.hypot(*error[:2])
        gain_ps = min(1.0, math.sqrt(2.0 * 1.2 / max(distance_m, 0.1)))  # so that it can brake before it is there
        velocity = tuple(v + gain_ps * e for v, e in zip(heard.velocity_ned_mps[:2], error[:2], strict=True))
        n_mps, e_mps = _no_faster(velocity, self.params["WPNAV_SPEED"] / 100.0)
        yaw = _facing(motion, target) if self.params["FOLL_YAW_BEHAVE"] == 1 else None
        down_mps = min(max(error[2], -self.params["WPNAV_SPEED_UP"] / 100), self.params["WPNAV_SPEED_DN"] / 100)
        return MotionCommand((n_mps, e_mps, down_mps), 0.0, yaw)


def _moved(position: Vec3, velocity: Vec3, time_s: float) -> Vec3:
    return (
        position[0] + velocity[0] * time_s,
        position[1] + velocity[1] * time_s,
        position[2] + velocity[2] * time_s,
    )


def _mixed(old: Vec3, new: Vec3, share: float) -> Vec3:
    return _moved(old, _moved(new, old, -1.0), share)


def _clamped(value: float, most: float) -> float:
    return min(max(value, -most), most)


def _no_faster(velocity: tuple[float, ...], most_mps: float) -> tuple[float, float]:
    scale = min(1.0, most_mps / max(math.hypot(*velocity), 1e-9))
    return velocity[0] * scale, velocity[1] * scale


def _facing(motion: Motion, target: Vec3) -> float | None:
    north, east = target[0] - motion.position_ned_m[0], target[1] - motion.position_ned_m[1]
    return math.atan2(east, north) if math.hypot(north, east) > _FACING_FROM_M else motion.yaw_rad

"""What the vehicle does in the air: one guidance rule per behaviour, on top of the point-mass dynamics."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import assert_never

from sitl_mocks.dynamics import MotionCommand, Multicopter, Vec3, body_to_ned, wrap_pi
from sitl_mocks.vehicle.follow_target import Follower
from sitl_mocks.vehicle.modes import Landed
from sitl_mocks.vehicle.setpoints import Setpoint

_HOLD_GAIN_PS = 0.5
_LOCK_BELOW_MPS = 0.3
_STICK_DEADZONE = 0.1
_NAN = math.nan


class Behaviour(Enum):
    """What the autopilot makes the airframe do, whatever its mode is called."""

    REST = "rest"
    HOLD = "hold"
    EXTERNAL = "external"
    TAKEOFF = "takeoff"
    LAND = "land"
    RETURN = "return"
    COAST_DOWN = "coast_down"  # PX4's Position mode without sticks: drifts on and sinks until it lands
    SINK = "sink"  # ArduCopter's LOITER with the throttle stick low
    STICKS = "sticks"  # the pilot flies, velocity by deflection; centred sticks hold
    FOLLOW = "follow"
    DESCEND = "descend"  # down without a position: drifts with what speed there is


@dataclass(frozen=True, slots=True)
class Speeds:
    """Speeds of the automatic manoeuvres in m/s, heights in m above home."""

    takeoff_mps: float
    land_mps: float
    land_high_mps: float
    cruise_mps: float
    climb_mps: float
    return_height_m: float
    land_slow_below_m: float
    spool_up_s: float = 1.0
    coast_sink_mps: float = 0.6
    stick_sink_mps: float = 2.5
    stick_mps: float = 10.0
    stick_yaw_rps: float = 2.5


@dataclass(frozen=True, slots=True)
class Sticks:
    """Deflections from -1 to 1: nose down (forward), right, up, clockwise."""

    forward: float = 0.0
    right: float = 0.0
    up: float = 0.0
    clockwise: float = 0.0

    @property
    def deflection(self) -> float:
        """The largest one."""
        return max(abs(self.forward), abs(self.right), abs(self.up), abs(self.clockwise))


CENTRED = Sticks()


@dataclass(slots=True)
class Flight:
    """Motion, landed state and the hold point. Position is NED with the origin at home."""

    body: Multicopter
    behaviour: Behaviour = Behaviour.REST
    landed: Landed = Landed.ON_GROUND
    setpoint: Setpoint | None = None
    takeoff_height_m: float = 2.5
    command: MotionCommand = field(default_factory=MotionCommand)
    hold_ned_m: Vec3 | None = None
    armed_t_s: float | None = None
    landed_t_s: float = 0.0
    sticks: Sticks = CENTRED
    follower: Follower | None = None
    _contact_s: float = 0.0

    @property
    def height_m(self) -> float:
        """Height above home in m."""
        return -self.body.motion.position_ned_m[2]

    @property
    def flying(self) -> bool:
        """In the air by the autopilot's landing detector."""
        return self.landed is not Landed.ON_GROUND

    @property
    def takeoff_done(self) -> bool:
        """A take-off has reached its height."""
        return self.behaviour is Behaviour.TAKEOFF and self.height_m >= self.takeoff_height_m - 0.15

    @property
    def home_distance_m(self) -> float:
        """Horizontal distance from home in m."""
        return math.hypot(*self.body.motion.position_ned_m[:2])

    def tick(self, behaviour: Behaviour, now_s: float, speeds: Speeds) -> None:
        """Advance by one dynamics tick under `behaviour`."""
        if behaviour is not self.behaviour:
            self.behaviour = behaviour
            self.hold_ned_m = None
            if self.follower is not None and behaviour is Behaviour.FOLLOW:
                self.follower.begin()
        self.command = self._guide(behaviour, speeds, now_s)
        if not self.flying and not self._may_lift(behaviour, now_s, speeds.spool_up_s):
            self.body.tick(None)
            return
        self.body.tick(self.command)
        self._detect_landing(behaviour, now_s)

    def disarm(self) -> None:
        """Motors off; the vehicle is on the ground or falls out of the model's world."""
        self.armed_t_s, self.landed, self.setpoint = None, Landed.ON_GROUND, None

    def _may_lift(self, behaviour: Behaviour, now_s: float, spool_up_s: float) -> bool:
        if self.armed_t_s is None or now_s - self.armed_t_s < spool_up_s:
            return False
        climbing = self.command.velocity_ned_mps[2] < -0.05
        return climbing and behaviour in (Behaviour.TAKEOFF, Behaviour.EXTERNAL)

    def _detect_landing(self, behaviour: Behaviour, now_s: float) -> None:
        if self.body.motion.on_ground and self.command.velocity_ned_mps[2] > -0.05:
            self._contact_s += self.body.tick_s
            if self._contact_s >= 0.5 and self.flying:
                self.landed, self.landed_t_s = Landed.ON_GROUND, now_s
            return
        self._contact_s = 0.0
        if behaviour is Behaviour.TAKEOFF:
            self.landed = Landed.TAKEOFF
        elif behaviour in (Behaviour.LAND, Behaviour.COAST_DOWN, Behaviour.DESCEND):
            self.landed = Landed.LANDING
        elif self.height_m > 0.1 or self.flying:
            self.landed = Landed.IN_AIR

    def _guide(self, behaviour: Behaviour, speeds: Speeds, now_s: float) -> MotionCommand:
        match behaviour:
            case Behaviour.REST:
                return MotionCommand()
            case Behaviour.HOLD:
                return self._hold(None)
            case Behaviour.EXTERNAL:
                return self._external(speeds)
            case Behaviour.FOLLOW:
                return self._follow(now_s)
            case Behaviour.TAKEOFF:
                return self._hold(-self._toward_height(self.takeoff_height_m, speeds.takeoff_mps))
            case Behaviour.LAND:
                return self._hold(self._descent_mps(speeds))
            case Behaviour.RETURN:
                return self._return(speeds)
            case Behaviour.COAST_DOWN:
                return MotionCommand((_NAN, _NAN, speeds.coast_sink_mps))
            case Behaviour.SINK:
                return self._hold(speeds.stick_sink_mps)
            case Behaviour.STICKS:
                return self._by_sticks(speeds)
            case Behaviour.DESCEND:
                return MotionCommand((_NAN, _NAN, speeds.land_mps))
            case _:
                assert_never(behaviour)

    def _hold(self, down_mps: float | None) -> MotionCommand:
        """Brake, then keep the point where the vehicle came to rest; down_mps replaces the height lock."""
        motion = self.body.motion
        if self.hold_ned_m is None:
            if math.hypot(*motion.velocity_ned_mps) > _LOCK_BELOW_MPS and down_mps is None:
                return MotionCommand()
            if math.hypot(*motion.velocity_ned_mps[:2]) > _LOCK_BELOW_MPS:
                return MotionCommand((0.0, 0.0, down_mps or 0.0))
            self.hold_ned_m = motion.position_ned_m
        north, east, down = self._toward(self.hold_ned_m, 2.0)
        return MotionCommand((north, east, down if down_mps is None else down_mps))

    def _follow(self, now_s: float) -> MotionCommand:
        command = None if self.follower is None else self.follower.guide(self.body.motion, now_s)
        if command is None:
            return self._hold(None)
        self.hold_ned_m = None
        return command

    def _by_sticks(self, speeds: Speeds) -> MotionCommand:
        sticks, yaw_rad = self.sticks, self.body.motion.yaw_rad
        if sticks.deflection < _STICK_DEADZONE:
            return self._hold(None)
        self.hold_ned_m = None
        forward, right = speeds.stick_mps * sticks.forward, speeds.stick_mps * sticks.right
        down = -sticks.up * speeds.climb_mps
        return MotionCommand(body_to_ned((forward, right, down), yaw_rad), speeds.stick_yaw_rps * sticks.clockwise)

    def _toward(self, point_ned_m: Vec3, limit_mps: float) -> Vec3:
        p = self.body.motion.position_ned_m
        error = (point_ned_m[0] - p[0], point_ned_m[1] - p[1], point_ned_m[2] - p[2])
        gain = _HOLD_GAIN_PS
        distance = math.hypot(error[0], error[1])
        if gain * distance > limit_mps:
            gain = limit_mps / distance
        return gain * error[0], gain * error[1], max(-limit_mps, min(limit_mps, error[2]))

    def _toward_height(self, height_m: float, limit_mps: float) -> float:
        """Climb rate (up positive) that ends at the height."""
        error_m = height_m + 0.05 - self.height_m
        braking_mps = math.sqrt(self.body.airframe.vertical.accel_max * abs(error_m))
        return math.copysign(min(limit_mps, 1.2 * abs(error_m), braking_mps), error_m)

    def _descent_mps(self, speeds: Speeds) -> float:
        return speeds.land_mps if self.height_m < speeds.land_slow_below_m else speeds.land_high_mps

    def _return(self, speeds: Speeds) -> MotionCommand:
        if self.home_distance_m < 1.0:
            return self._hold(self._descent_mps(speeds))
        climb = self._toward_height(max(speeds.return_height_m, self.height_m), speeds.climb_mps)
        if self.height_m < speeds.return_height_m - 0.5:
            return MotionCommand((0.0, 0.0, -climb))
        north, east, _ = self._toward((0.0, 0.0, 0.0), speeds.cruise_mps)
        return MotionCommand((north, east, -climb))

    def _external(self, speeds: Speeds) -> MotionCommand:
        setpoint = self.setpoint
        if setpoint is None:
            return self._hold(None)
        self.hold_ned_m = None
        velocity = setpoint.velocity_ned_mps
        if setpoint.position_ned_m is not None:
            toward = self._toward(setpoint.position_ned_m, speeds.cruise_mps)
            feed = tuple(0.0 if math.isnan(v) else v for v in velocity)
            velocity = (toward[0] + feed[0], toward[1] + feed[1], toward[2] + feed[2])
        yaw = None if setpoint.yaw_rad is None else wrap_pi(setpoint.yaw_rad)
        return MotionCommand(velocity, setpoint.yaw_rate_rps, yaw)

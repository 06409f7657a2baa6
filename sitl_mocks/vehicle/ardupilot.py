"""ArduCopter's answers, modes and failsafes, as measured on 4.7.0-dev in SITL."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from sitl_mocks.vehicle.ardupilot_failsafes import ArduPilotFailsafes
from sitl_mocks.vehicle.autopilot import CUSTOM_MODE_FLAG, Autopilot
from sitl_mocks.vehicle.flight import Behaviour, Speeds, Sticks
from sitl_mocks.vehicle.follow_target import Follow
from sitl_mocks.vehicle.modes import ARDUPILOT_NUMBERS, Mode, Personality, Result, Severity
from sitl_mocks.vehicle.setpoints import BadSetpointError, Setpoint

_MODE_OF = {number: mode for mode, number in ARDUPILOT_NUMBERS.items()}
_ACCEPTED_WITHOUT_EFFECT = frozenset({115, 178, 192, 207, 510, 520})
_LOW_THROTTLE = -0.1


@dataclass(slots=True)
class ArduPilot(ArduPilotFailsafes):
    """ArduCopter. A take-off happens inside GUIDED; lost setpoints stop it silently, still in GUIDED."""

    NOT_ARMABLE: ClassVar[frozenset[Mode]] = frozenset({Mode.RETURN, Mode.LAND, Mode.BRAKE, Mode.MISSION, Mode.FOLLOW})

    mode: Mode = Mode.STABILIZE
    intended: Mode = Mode.STABILIZE
    throttle_stick_low: bool = True

    def __post_init__(self) -> None:
        self.flight.follower = Follow(self.params)

    @property
    def personality(self) -> Personality:
        """Whose behaviour this is."""
        return Personality.ARDUPILOT

    def execute(self, command: int, params: Sequence[float], now_s: float) -> Result | None:
        """Do a MAV_CMD; every command gets a COMMAND_ACK."""
        match command:
            case 400:
                return self._arm_disarm(params[0], now_s)
            case 176:
                return self._set_mode(params)
            case 22:
                return self._take_off(params[6])
            case 21:
                self.change_mode(Mode.LAND)
                return Result.ACCEPTED
            case 20:
                self.change_mode(Mode.RETURN)
                return Result.ACCEPTED
            case 300:
                return Result.FAILED
            case _ if command in _ACCEPTED_WITHOUT_EFFECT:
                return Result.ACCEPTED
        return Result.UNSUPPORTED

    def _arm_disarm(self, arm: float, now_s: float) -> Result:
        if arm == 1.0:
            return self._arm(now_s)
        if arm == 0.0:
            if self.armed and self.flight.flying:
                return Result.FAILED
            self.do_disarm()
            return Result.ACCEPTED
        return Result.UNSUPPORTED

    def _arm(self, now_s: float) -> Result:
        if self.armed:
            return Result.ACCEPTED
        if not self.ready:
            self.say(Severity.CRITICAL, "PreArm: Need Position Estimate")
            return Result.FAILED
        if self.mode in self.NOT_ARMABLE:
            self.say(Severity.CRITICAL, "Arm: Mode not armable")
            return Result.FAILED
        self.do_arm(now_s)
        return Result.ACCEPTED

    def _set_mode(self, params: Sequence[float]) -> Result:
        base, number = (0 if math.isnan(p) else int(p) for p in params[:2])
        if not base & CUSTOM_MODE_FLAG:
            return Result.DENIED
        mode = _MODE_OF.get(number)
        if mode is None:
            self.say(Severity.WARNING, f"No such mode {number}")
            return Result.FAILED
        if mode is Mode.FOLLOW and self.params["FOLL_ENABLE"] != 1:
            self.say(Severity.WARNING, "Set FOLL_ENABLE = 1")
            return Result.FAILED
        self.change_mode(mode)
        return Result.ACCEPTED

    def _take_off(self, height_m: float) -> Result:
        if self.mode is not Mode.EXTERNAL or not self.armed or self.flight.flying:
            return Result.FAILED
        if not math.isfinite(height_m) or height_m <= 0.0:
            return Result.FAILED
        self.flight.takeoff_height_m = height_m
        self.taking_off = True
        return Result.ACCEPTED

    def change_mode(self, mode: Mode) -> None:
        """A new mode starts without an old take-off or setpoint; the same mode again changes nothing."""
        if mode is not self.mode:
            self.taking_off = False
            self.flight.setpoint = None
        Autopilot.change_mode(self, mode)

    def take_setpoint(self, setpoint: Setpoint) -> None:
        """Setpoints outside GUIDED are not even remembered."""
        if self.mode is Mode.EXTERNAL:
            Autopilot.take_setpoint(self, setpoint)
            if self.flight.flying:
                self.taking_off = False

    def hear_sticks(self, sticks: Sticks, now_s: float) -> None:
        """Sticks do nothing in GUIDED; in the pilot's modes the throttle decides between holding and sinking."""
        self.sticks_present, self.sticks_t_s, self.flight.sticks = True, now_s, sticks
        self.throttle_stick_low = sticks.up < _LOW_THROTTLE

    def behaviour(self) -> Behaviour:
        """What the airframe does now; with the throttle stick low the pilot's modes sink."""
        if not self.armed:
            return Behaviour.REST
        match self.mode:
            case Mode.EXTERNAL:
                return Behaviour.TAKEOFF if self.taking_off else self._guided()
            case Mode.LAND:
                return Behaviour.LAND if self.position_valid else Behaviour.DESCEND
            case Mode.RETURN:
                return Behaviour.RETURN
            case Mode.BRAKE | Mode.MISSION | Mode.TAKEOFF:
                return Behaviour.HOLD
            case Mode.FOLLOW:
                return Behaviour.FOLLOW if self.flight.flying else Behaviour.HOLD
        return Behaviour.SINK if self.throttle_stick_low else Behaviour.STICKS

    def _guided(self) -> Behaviour:
        # Off the ground only a take-off lifts it: a climbing velocity setpoint does nothing before.
        return Behaviour.EXTERNAL if self.flight.flying else Behaviour.HOLD

    def make_speeds(self) -> Speeds:
        """Manoeuvre speeds from the parameters (cm/s there)."""
        return Speeds(
            takeoff_mps=self.params["WPNAV_SPEED_UP"] / 100.0,
            land_mps=self.params["LAND_SPEED"] / 100.0,
            land_high_mps=self.params["WPNAV_SPEED_DN"] / 100.0,
            cruise_mps=self.params["WPNAV_SPEED"] / 100.0,
            climb_mps=self.params["WPNAV_SPEED_UP"] / 100.0,
            return_height_m=self.params["RTL_ALT"] / 100.0,
            land_slow_below_m=10.0,
        )

    def base_mode(self) -> int:
        """HEARTBEAT.base_mode."""
        guided = self.mode in (Mode.EXTERNAL, Mode.RETURN, Mode.LAND, Mode.MISSION, Mode.BRAKE, Mode.HOLD, Mode.FOLLOW)
        return (0x59 if guided else 0x51) | (0x80 if self.armed else 0)

    def system_status(self) -> int:
        """HEARTBEAT.system_status: 5 failsafe, 4 flying, 3 on the ground."""
        if self.failsafe is not None:
            return 5
        return 4 if self.flight.flying else 3

    def bad_setpoint(self, error: BadSetpointError) -> None:
        """ArduCopter says nothing."""
        del error

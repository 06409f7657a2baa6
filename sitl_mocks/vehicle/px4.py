"""PX4's answers, modes and failsafes, as measured between v1.15 and v1.16 in SITL."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sitl_mocks.vehicle.autopilot import CUSTOM_MODE_FLAG, Failsafe
from sitl_mocks.vehicle.flight import Behaviour, Speeds
from sitl_mocks.vehicle.follow_target import FollowMe
from sitl_mocks.vehicle.modes import (
    AUTO_MODES,
    PX4_NUMBERS,
    STICK_MODES,
    Mode,
    Personality,
    Result,
    Severity,
)
from sitl_mocks.vehicle.px4_failsafes import Px4Failsafes
from sitl_mocks.vehicle.setpoints import BadSetpointError

_MODE_OF = {number: mode for mode, number in PX4_NUMBERS.items()}
_MAIN_MODES = frozenset(range(1, 9))
_ACCEPTED_WITHOUT_EFFECT = frozenset({178, 192, 510, 519, 520})
_BEHAVIOURS = {
    Mode.EXTERNAL: Behaviour.EXTERNAL,
    Mode.TAKEOFF: Behaviour.TAKEOFF,
    Mode.LAND: Behaviour.LAND,
    Mode.RETURN: Behaviour.RETURN,
    Mode.FOLLOW: Behaviour.FOLLOW,
}
_NOT_ARMABLE = "Arming denied: Resolve system health failures first"


@dataclass(slots=True)
class Px4(Px4Failsafes):
    """PX4. Its heartbeat never comes early, so a mode change shows in CURRENT_MODE first."""

    def __post_init__(self) -> None:
        self.flight.follower = FollowMe(self.params)

    @property
    def personality(self) -> Personality:
        """Whose behaviour this is."""
        return Personality.PX4

    def execute(self, command: int, params: Sequence[float], now_s: float) -> Result | None:
        """Do a MAV_CMD; None = no COMMAND_ACK."""
        match command:
            case 400:
                return self._arm_disarm(params[0], now_s)
            case 176:
                return self._set_mode(params, now_s)
            case 22:
                return self._take_off(params[6])
            case 21:
                self.change_mode(Mode.LAND)
                return Result.ACCEPTED
            case 20:
                self.change_mode(Mode.RETURN)
                return Result.ACCEPTED
            case 300:
                self.say(Severity.CRITICAL, "Mission start denied: no valid mission\t")
                return Result.DENIED
            case _ if command in _ACCEPTED_WITHOUT_EFFECT:
                return Result.ACCEPTED
        return Result.UNSUPPORTED

    def _arm_disarm(self, arm: float, now_s: float) -> Result | None:
        if arm == 1.0:
            if not self.armed and not self._armable(now_s):
                return self._reject(_NOT_ARMABLE)
            self.do_arm(now_s)
            return Result.ACCEPTED
        if arm == 0.0:
            if self.armed and self.flight.flying:
                return self._reject("Disarming denied: not landed")
            self.do_disarm()
            return Result.ACCEPTED
        self.say(Severity.CRITICAL, f"Unsupported ARM_DISARM param: {arm:.3f}\t")
        return None

    def _armable(self, now_s: float) -> bool:
        if self.mode is Mode.EXTERNAL and not self.setpoints_fresh(now_s):
            return False
        return self.ready and not (self.mode in STICK_MODES and not self.sticks_present)

    def _reject(self, text: str) -> Result:
        self.say(Severity.CRITICAL, f"{text}\t")
        return Result.TEMPORARILY_REJECTED

    def _set_mode(self, params: Sequence[float], now_s: float) -> Result:
        values = [0 if math.isnan(p) else int(p) for p in params[:3]]
        base, main, sub = values
        if not base & CUSTOM_MODE_FLAG or main not in _MAIN_MODES:
            return Result.ACCEPTED  # measured: accepted, and nothing changes
        mode = _MODE_OF.get(main << 16 | (sub << 24 if main == 4 else 0))
        if mode is None:
            return self._reject("Unsupported auto mode") if main == 4 else Result.UNSUPPORTED
        blind = not self.position_valid or not self.setpoints_fresh(now_s)
        if mode is Mode.EXTERNAL and self.flight.flying and blind:
            return self._reject("Switching to Offboard is currently not available")
        if mode in STICK_MODES and self.armed and not self.sticks_present:
            return self._reject("Switching to Position is currently not available")
        self.change_mode(mode)
        return Result.ACCEPTED

    def _take_off(self, altitude_amsl_m: float) -> Result:
        del altitude_amsl_m  # MAVSDK and most stations send NaN: the height is a parameter
        if not self.flight.flying:
            self.flight.takeoff_height_m = self.params["MIS_TAKEOFF_ALT"]
        self.change_mode(Mode.TAKEOFF)
        return Result.ACCEPTED

    def behaviour(self) -> Behaviour:
        """What the airframe does now."""
        if not self.armed:
            return Behaviour.REST
        if self.mode in STICK_MODES:
            return Behaviour.STICKS if self.sticks_present else Behaviour.COAST_DOWN
        if not self.position_valid and self.failsafe is Failsafe.POSITION_LOST:
            return Behaviour.DESCEND
        return _BEHAVIOURS.get(self.mode, Behaviour.HOLD)

    def make_speeds(self) -> Speeds:
        """Manoeuvre speeds from the parameters."""
        return Speeds(
            takeoff_mps=self.params["MPC_TKO_SPEED"],
            land_mps=self.params["MPC_LAND_SPEED"],
            land_high_mps=self.params["MPC_Z_VEL_MAX_DN"],
            cruise_mps=self.params["MPC_XY_CRUISE"],
            climb_mps=2.8,
            return_height_m=self.params["RTL_RETURN_ALT"],
            land_slow_below_m=5.0,
            spool_up_s=self.params["COM_SPOOLUP_TIME"],
            stick_mps=self.params["MPC_VEL_MANUAL"],
        )

    def base_mode(self) -> int:
        """HEARTBEAT.base_mode."""
        if self.mode in STICK_MODES:
            mode = 0x51
        elif self.mode in AUTO_MODES:
            mode = 0x1D
        else:
            mode = 0x11 if self.armed or self.setpoints_ok else 0x01
        return mode | (0x80 if self.armed else 0)

    def system_status(self) -> int:
        """HEARTBEAT.system_status: 5 is a failsafe, 4 armed, 3 standby, 0 not armable."""
        if self.failsafe is not None:
            return 5
        if self.armed:
            return 4
        stickless = self.mode in STICK_MODES and not self.sticks_present
        blind = self.mode is Mode.EXTERNAL and not self.setpoints_ok
        return 3 if self.ready and not stickless and not blind else 0

    def bad_setpoint(self, error: BadSetpointError) -> None:
        """PX4 says so once per message."""
        self.say(Severity.CRITICAL, f"{error}\t")

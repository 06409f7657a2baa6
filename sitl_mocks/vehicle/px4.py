"""PX4's answers, modes and failsafes, as measured between v1.15 and v1.16 in SITL."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sitl_mocks.vehicle.autopilot import CUSTOM_MODE_FLAG, Autopilot, Failsafe
from sitl_mocks.vehicle.flight import Behaviour, Speeds
from sitl_mocks.vehicle.modes import (
    AUTO_MODES,
    PX4_NUMBERS,
    STICK_MODES,
    Mode,
    Personality,
    Result,
    Severity,
)
from sitl_mocks.vehicle.setpoints import BadSetpointError, Setpoint

_MODE_OF = {number: mode for mode, number in PX4_NUMBERS.items()}
_MAIN_MODES = frozenset(range(1, 9))
_ACCEPTED_WITHOUT_EFFECT = frozenset({178, 192, 510, 519, 520})
# The commander looks at the setpoints' age a few times a second: failsafe and way back come that much later.
_OFFBOARD_CHECK_S = 0.05
# Measured: Hold 11.9 s after the last heartbeat with COM_DL_LOSS_T 10.
_DATA_LINK_EXTRA_S = 1.9
_OFFBOARD_LOSS_MODES = {
    0: Mode.POSITION,
    1: Mode.ALTITUDE,
    2: Mode.STABILIZE,
    3: Mode.RETURN,
    4: Mode.LAND,
    5: Mode.HOLD,
}
_MANOEUVRES = frozenset({Mode.TAKEOFF, Mode.LAND, Mode.RETURN})
_NOT_ARMABLE = "Arming denied: Resolve system health failures first"


@dataclass(slots=True)
class Px4(Autopilot):
    """PX4. Its heartbeat never comes early, so a mode change shows in CURRENT_MODE first."""

    setpoints_back_t_s: float | None = None
    mode_after_landing: Mode = Mode.HOLD

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
        if self.mode is Mode.EXTERNAL and not self._setpoints_fresh(now_s):
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
        if mode is Mode.EXTERNAL and self.flight.flying and not self._setpoints_fresh(now_s):
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

    def change_mode(self, mode: Mode) -> None:
        """A mode wanted by a person; after a landing the mode before the manoeuvre comes back."""
        if mode in _MANOEUVRES and self.intended not in _MANOEUVRES:
            self.mode_after_landing = self.intended
        Autopilot.change_mode(self, mode)

    def _setpoints_fresh(self, now_s: float) -> bool:
        return self.setpoint_age_s(now_s) <= self.params["COM_OF_LOSS_T"]

    def take_setpoint(self, setpoint: Setpoint) -> None:
        """PX4 also remembers when setpoints came back after a gap."""
        if self.setpoints_back_t_s is None or not self._setpoints_fresh(setpoint.t_s):
            self.setpoints_back_t_s = setpoint.t_s
        Autopilot.take_setpoint(self, setpoint)

    def watch(self, now_s: float) -> None:
        """Failsafes and timers, once a tick."""
        self.ready = self.ready or now_s >= self.ready_t_s
        self._watch_setpoints(now_s)
        self._watch_data_link(now_s)
        self._watch_fence(now_s)
        if self.flight.takeoff_done and self.mode is Mode.TAKEOFF:
            self.mode = self.intended = Mode.HOLD
        if self.armed and not self.flight.flying:
            self._disarm_on_ground(now_s)

    def _watch_setpoints(self, now_s: float) -> None:
        if self.intended is not Mode.EXTERNAL or not self.armed:
            return
        if self.mode is Mode.EXTERNAL:
            late = self.setpoint_age_s(now_s) > self.params["COM_OF_LOSS_T"] + _OFFBOARD_CHECK_S
            if late:
                mode = _OFFBOARD_LOSS_MODES.get(int(self.params["COM_OBL_RC_ACT"]), Mode.HOLD)
                self.start_failsafe(Failsafe.SETPOINTS_LOST, mode, now_s)
                self.say(Severity.CRITICAL, "Failsafe activated\t")
        elif self.failsafe is Failsafe.SETPOINTS_LOST and self._setpoints_fresh(now_s):
            back = self.setpoints_back_t_s
            if back is not None and back > self.failsafe_t_s and now_s - back >= _OFFBOARD_CHECK_S:
                self.change_mode(Mode.EXTERNAL)

    def _watch_data_link(self, now_s: float) -> None:
        if self.gcs_heartbeat_t_s is None:
            return
        silence_s = now_s - self.gcs_heartbeat_t_s
        limit_s = self.params["COM_DL_LOSS_T"] + _DATA_LINK_EXTRA_S
        action = int(self.params["NAV_DLL_ACT"])
        if silence_s > limit_s and not self.gcs_lost:
            self.gcs_lost = True
            self.say(Severity.WARNING, "Connection to ground station lost\t")
            if action in (1, 2) and self.armed:
                self.start_failsafe(Failsafe.DATA_LINK, Mode.HOLD, now_s)
        elif silence_s <= limit_s and self.gcs_lost:
            self.gcs_lost = False
            self.say(Severity.INFO, "GCS connection regained\t")
            if self.failsafe is Failsafe.DATA_LINK and self.mode is Mode.HOLD:
                self.change_mode(self.intended)
        if action == 2:
            self._return_after_holding(Failsafe.DATA_LINK, now_s)

    def _watch_fence(self, now_s: float) -> None:
        radius_m, action = self.params["GF_MAX_HOR_DIST"], int(self.params["GF_ACTION"])
        outside = radius_m > 0.0 and self.flight.flying and self.flight.home_distance_m > radius_m
        if outside and not self.outside_fence:
            self.say(Severity.CRITICAL, "Geofence violation: exceeding maximum distance to Home\t")
            if action >= 2:
                self.start_failsafe(Failsafe.GEOFENCE, Mode.HOLD, now_s)
        self.outside_fence = outside
        if action == 3:
            self._return_after_holding(Failsafe.GEOFENCE, now_s)

    def _return_after_holding(self, cause: Failsafe, now_s: float) -> None:
        holding = self.failsafe is cause and self.mode is Mode.HOLD
        if holding and now_s - self.failsafe_t_s >= self.params["COM_FAIL_ACT_T"]:
            self.mode = Mode.RETURN

    def _disarm_on_ground(self, now_s: float) -> None:
        armed_t_s, landed_t_s = self.flight.armed_t_s, self.flight.landed_t_s
        if armed_t_s is None:
            return
        flown = landed_t_s > armed_t_s
        since_s = now_s - (landed_t_s if flown else armed_t_s)
        if since_s >= self.params["COM_DISARM_LAND" if flown else "COM_DISARM_PRFLT"]:
            self.do_disarm()
            self.failsafe = None
            if self.intended in _MANOEUVRES:
                self.intended = self.mode_after_landing
            self.mode = self.intended

    def pilot_moves_sticks(self) -> bool:
        """A full stick deflection: takes over only where COM_RC_OVERRIDE says so. True if it did."""
        self.sticks_present = True
        bit = 2 if self.mode is Mode.EXTERNAL else 1
        if self.mode in STICK_MODES or not int(self.params["COM_RC_OVERRIDE"]) & bit:
            return False
        self.change_mode(Mode.POSITION)
        self.say(Severity.INFO, "Pilot took over using sticks\t")
        return True

    def behaviour(self) -> Behaviour:
        """What the airframe does now."""
        if not self.armed:
            return Behaviour.REST
        if self.mode in STICK_MODES:
            return Behaviour.HOLD if self.sticks_present else Behaviour.COAST_DOWN
        return {
            Mode.EXTERNAL: Behaviour.EXTERNAL,
            Mode.TAKEOFF: Behaviour.TAKEOFF,
            Mode.LAND: Behaviour.LAND,
            Mode.RETURN: Behaviour.RETURN,
        }.get(self.mode, Behaviour.HOLD)

    def speeds(self) -> Speeds:
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
        )

    def base_mode(self) -> int:
        """HEARTBEAT.base_mode."""
        if self.mode in STICK_MODES:
            mode = 0x51
        elif self.mode in AUTO_MODES:
            mode = 0x1D
        else:
            mode = 0x11 if self.armed or self.setpoint_t_s is not None else 0x01
        return mode | (0x80 if self.armed else 0)

    def system_status(self) -> int:
        """HEARTBEAT.system_status: 5 is a failsafe, 4 armed, 3 standby, 0 not armable."""
        if self.failsafe is not None:
            return 5
        if self.armed:
            return 4
        stickless = self.mode in STICK_MODES and not self.sticks_present
        blind = self.mode is Mode.EXTERNAL and self.setpoint_t_s is None
        return 3 if self.ready and not stickless and not blind else 0

    def bad_setpoint(self, error: BadSetpointError) -> None:
        """PX4 says so once per message."""
        self.say(Severity.CRITICAL, f"{error}\t")

"""What PX4 does by itself: failsafes, each on its own clock, and the way back."""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass

from sitl_mocks.vehicle.autopilot import Autopilot, Failsafe
from sitl_mocks.vehicle.flight import CENTRED, Sticks
from sitl_mocks.vehicle.modes import STICK_MODES, Mode, Severity
from sitl_mocks.vehicle.setpoints import Setpoint

MANOEUVRES = frozenset({Mode.TAKEOFF, Mode.LAND, Mode.RETURN})
# The commander looks at the setpoints' age a few times a second: failsafe and way back come that much later.
_OFFBOARD_CHECK_S = 0.05
# Measured: Hold 11.9 s after the last heartbeat with COM_DL_LOSS_T 10, 0.64 s after the last stick message with
# COM_RC_LOSS_T 0.5.
_DATA_LINK_EXTRA_S = 1.9
_STICKS_EXTRA_S = 0.14
_OFFBOARD_LOSS_MODES = {
    0: Mode.POSITION,
    1: Mode.ALTITUDE,
    2: Mode.STABILIZE,
    3: Mode.RETURN,
    4: Mode.LAND,
    5: Mode.HOLD,
}
_AFTER_HOLD = {2: Mode.RETURN, 3: Mode.LAND}  # NAV_DLL_ACT and NAV_RCL_ACT, once COM_FAIL_ACT_T is over
_EXCEPTION_BITS = {Mode.MISSION: 1, Mode.HOLD: 2, Mode.EXTERNAL: 4}  # COM_RCL_EXCEPT
_SUPPLY_CHECK_OFF = 894281  # CBRK_SUPPLY_CHK as the simulators have it


@dataclass(slots=True)
class Px4Failsafes(Autopilot, ABC):
    """`watch` once a tick; the intended mode is kept through a failsafe."""

    setpoints_back_t_s: float | None = None
    setpoints_ok: bool = False
    mode_after_landing: Mode = Mode.HOLD
    battery_action: Mode | None = None  # what it has done about the battery; a person may undo that once per level

    def change_mode(self, mode: Mode) -> None:
        """A mode wanted by a person; after a landing the mode before the manoeuvre comes back."""
        if mode in MANOEUVRES and self.intended not in MANOEUVRES:
            self.mode_after_landing = self.intended
        Autopilot.change_mode(self, mode)

    def setpoints_fresh(self, now_s: float) -> bool:
        """Whether they are younger than COM_OF_LOSS_T."""
        return self.setpoint_age_s(now_s) <= self.params["COM_OF_LOSS_T"]

    def take_setpoint(self, setpoint: Setpoint) -> None:
        """PX4 also remembers when setpoints came back after a gap."""
        if self.setpoints_back_t_s is None or not self.setpoints_fresh(setpoint.t_s):
            self.setpoints_back_t_s = setpoint.t_s
        Autopilot.take_setpoint(self, setpoint)

    def watch(self, now_s: float) -> None:
        """Failsafes and timers, once a tick."""
        self.ready = self.ready or now_s >= self.ready_t_s
        self.setpoints_ok = self.setpoints_fresh(now_s)
        self._watch_setpoints(now_s)
        self._watch_data_link(now_s)
        self._watch_fence(now_s)
        self._watch_sticks(now_s)
        self._watch_position(now_s)
        self._watch_battery(now_s)
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
        elif self.failsafe is Failsafe.SETPOINTS_LOST and self.setpoints_fresh(now_s):
            back = self.setpoints_back_t_s
            came_back = back is not None and back > self.failsafe_t_s and now_s - back >= _OFFBOARD_CHECK_S
            if came_back and self.position_valid:
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
            if action in (1, 2, 3) and self.armed:
                self.start_failsafe(Failsafe.DATA_LINK, Mode.HOLD, now_s)
        elif silence_s <= limit_s and self.gcs_lost:
            self.gcs_lost = False
            self.say(Severity.INFO, "GCS connection regained\t")
            if self.failsafe is Failsafe.DATA_LINK and self.mode is Mode.HOLD:
                self.change_mode(self.intended)
        self._act_after_holding(Failsafe.DATA_LINK, _AFTER_HOLD.get(action), now_s)

    def _watch_fence(self, now_s: float) -> None:
        radius_m, ceiling_m = self.params["GF_MAX_HOR_DIST"], self.params["GF_MAX_VER_DIST"]
        action = int(self.params["GF_ACTION"])
        far = 0.0 < radius_m < self.flight.home_distance_m
        outside = self.flight.flying and (far or 0.0 < ceiling_m < self.flight.height_m)
        if outside and not self.outside_fence:
            what = "distance to" if far else "altitude above"
            self.say(Severity.CRITICAL, f"Geofence violation: exceeding maximum {what} Home\t")
            if action >= 2:
                self.start_failsafe(Failsafe.GEOFENCE, Mode.LAND if action == 5 else Mode.HOLD, now_s)
        self.outside_fence = outside
        self._act_after_holding(Failsafe.GEOFENCE, Mode.RETURN if action == 3 else None, now_s)

    def _act_after_holding(self, cause: Failsafe, then: Mode | None, now_s: float) -> None:
        if self.failsafe is not cause or self.mode is not Mode.HOLD or then is None:
            return
        if now_s - self.failsafe_t_s >= self.params["COM_FAIL_ACT_T"]:
            self.mode = then

    def _watch_sticks(self, now_s: float) -> None:
        """Sticks that have been there and fall silent; never seen, they are not missed."""
        if self.sticks_t_s is None:
            return
        lost = now_s - self.sticks_t_s > self.params["COM_RC_LOSS_T"] + _STICKS_EXTRA_S
        action = int(self.params["NAV_RCL_ACT"])
        if lost and self.sticks_present:
            self.sticks_present, self.flight.sticks = False, CENTRED
            excepted = int(self.params["COM_RCL_EXCEPT"]) & _EXCEPTION_BITS.get(self.mode, 0)
            if action and self.armed and not excepted and self.failsafe is None:
                self.say(Severity.CRITICAL, "Failsafe activated\t")
                self.start_failsafe(Failsafe.STICKS_LOST, Mode.HOLD, now_s)
        self._act_after_holding(Failsafe.STICKS_LOST, _AFTER_HOLD.get(action), now_s)

    def _watch_position(self, now_s: float) -> None:
        """Without a velocity no mode that needs one can go on; with it back, the intended one comes back too."""
        if not self.position_valid:
            blind = self.armed and self.failsafe is not Failsafe.POSITION_LOST
            if blind and self.mode not in (Mode.ALTITUDE, Mode.STABILIZE):
                self.say(Severity.CRITICAL, "Failsafe activated\t")
                mode = Mode.ALTITUDE if self.sticks_present else Mode.LAND
                self.start_failsafe(Failsafe.POSITION_LOST, mode, now_s)
            return
        possible = self.intended is not Mode.EXTERNAL or self.setpoints_fresh(now_s)
        if self.failsafe is Failsafe.POSITION_LOST and self.armed and possible:
            self.change_mode(self.intended)

    def _watch_battery(self, now_s: float) -> None:
        """COM_LOW_BAT_ACT, where the supply check is not switched off as it is in the simulators."""
        action, left = int(self.params["COM_LOW_BAT_ACT"]), self.battery_frac
        critical = left <= self.params["BAT_CRIT_THR"]
        if not critical or int(self.params["CBRK_SUPPLY_CHK"]) == _SUPPLY_CHECK_OFF or not self.armed:
            return
        emergency = left <= self.params["BAT_EMERGEN_THR"]
        wanted = {2: Mode.LAND, 3: Mode.LAND if emergency else Mode.RETURN}.get(action)
        if wanted in (None, self.battery_action) or not self.flight.flying:
            return
        self.battery_action = wanted
        self.say(Severity.CRITICAL, "Emergency battery level\t" if emergency else "Critical battery level\t")
        self.start_failsafe(Failsafe.BATTERY, wanted, now_s)

    def _disarm_on_ground(self, now_s: float) -> None:
        armed_t_s, landed_t_s = self.flight.armed_t_s, self.flight.landed_t_s
        if armed_t_s is None:
            return
        flown = landed_t_s > armed_t_s
        since_s = now_s - (landed_t_s if flown else armed_t_s)
        if since_s >= self.params["COM_DISARM_LAND" if flown else "COM_DISARM_PRFLT"]:
            self.do_disarm()
            self.failsafe = None
            if self.intended in MANOEUVRES:
                self.intended = self.mode_after_landing
            self.mode = self.intended

    def hear_sticks(self, sticks: Sticks, now_s: float) -> None:
        """Sticks are there; a deflection may take over."""
        self.sticks_present, self.sticks_t_s, self.flight.sticks = True, now_s, sticks
        if sticks.deflection > self.params["COM_RC_STICK_OV"] / 100.0:
            self.pilot_moves_sticks()

    def pilot_moves_sticks(self) -> bool:
        """A full stick deflection: takes over only where COM_RC_OVERRIDE says so. True if it did."""
        self.sticks_present = True
        bit = 2 if self.mode is Mode.EXTERNAL else 1
        if self.mode in STICK_MODES or not int(self.params["COM_RC_OVERRIDE"]) & bit:
            return False
        self.change_mode(Mode.POSITION)
        self.say(Severity.INFO, "Pilot took over using sticks\t")
        return True

"""What ArduCopter does by itself: failsafes of the station, the radio, the fence, the estimator and the battery."""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass

from sitl_mocks.vehicle.autopilot import Autopilot, Failsafe, battery_volts
from sitl_mocks.vehicle.flight import CENTRED
from sitl_mocks.vehicle.modes import Mode, Severity

_DISARM_AFTER_LANDING_S = 1.0
_RADIO_TIMEOUT_S = 1.0
# SmartRTL is not modelled: where it is asked for first, what comes instead happens.
_GCS_ACTIONS = {
    1: Mode.RETURN, 2: Mode.RETURN, 3: Mode.RETURN, 4: Mode.LAND, 5: Mode.LAND, 6: Mode.RETURN, 7: Mode.BRAKE,
}  # fmt: skip
_RADIO_ACTIONS = _GCS_ACTIONS | {3: Mode.LAND, 4: Mode.RETURN}
_FENCE_ACTIONS = {1: Mode.RETURN, 2: Mode.LAND, 3: Mode.RETURN, 4: Mode.BRAKE, 5: Mode.LAND}
_ESTIMATOR_ACTIONS = {1: Mode.LAND, 2: Mode.ALTITUDE, 3: Mode.LAND}
_BATTERY_ACTIONS = {1: Mode.LAND, 2: Mode.RETURN}
_PILOTS_MODES = frozenset({Mode.STABILIZE, Mode.ALTITUDE, Mode.POSITION, Mode.HOLD})
_GUIDED_GOES_ON, _PILOT_GOES_ON = 4, 16  # FS_OPTIONS: GUIDED on a radio failsafe, pilot's modes on a GCS one
_ALTITUDE_FENCE, _CIRCLE_FENCE = 1, 2


@dataclass(slots=True)
class ArduPilotFailsafes(Autopilot, ABC):
    """`watch` once a tick. A failsafe changes the mode once and leaves it there when its cause is over."""

    taking_off: bool = False
    battery_acted: bool = False

    def counts_as_gcs(self, system_id: int) -> bool:
        """Only the station of MAV_GCS_SYSID feeds the GCS failsafe."""
        return system_id == int(self.params["MAV_GCS_SYSID"])

    def watch(self, now_s: float) -> None:
        """Failsafes and timers, once a tick."""
        if not self.ready and now_s >= self.ready_t_s:
            self.ready = True
            self.say(Severity.INFO, "EKF3 IMU0 is using GPS")
        if self.setpoint_age_s(now_s) > self.params["GUID_TIMEOUT"]:
            self.flight.setpoint = None
        if self.flight.takeoff_done:
            self.taking_off = False
        self._watch_gcs(now_s)
        self._watch_radio(now_s)
        self._watch_fence(now_s)
        self._watch_estimator(now_s)
        self._watch_battery(now_s)
        if self.armed and not self.flight.flying:
            self._disarm_on_ground(now_s)

    def _watch_gcs(self, now_s: float) -> None:
        if self.gcs_heartbeat_t_s is None:
            return
        # Measured 4.7 to 4.9 s with the time-out at 5 s.
        lost = now_s - self.gcs_heartbeat_t_s > self.params["FS_GCS_TIMEOUT"] - 0.2
        if lost and not self.gcs_lost and self.armed:
            mode = _GCS_ACTIONS.get(int(self.params["FS_GCS_ENABLE"]))
            spared = self.mode in _PILOTS_MODES and int(self.params["FS_OPTIONS"]) & _PILOT_GOES_ON
            if mode is not None and not spared:
                self.gcs_lost = True
                self.say(Severity.WARNING, "GCS Failsafe")
                self._act(Failsafe.DATA_LINK, mode, now_s)
        elif self.gcs_lost and not lost:
            self.gcs_lost = False
            self.failsafe = None
            self.say(Severity.WARNING, "GCS Failsafe Cleared")

    def _watch_radio(self, now_s: float) -> None:
        """A transmitter, or a station's sticks, that has been there and falls silent."""
        if self.sticks_t_s is None or not self.sticks_present or now_s - self.sticks_t_s <= _RADIO_TIMEOUT_S:
            return
        self.sticks_present, self.flight.sticks = False, CENTRED
        mode = _RADIO_ACTIONS.get(int(self.params["FS_THR_ENABLE"]))
        spared = self.mode is Mode.EXTERNAL and int(self.params["FS_OPTIONS"]) & _GUIDED_GOES_ON
        if mode is not None and self.armed and not spared:
            self.say(Severity.WARNING, "Radio Failsafe")
            self._act(Failsafe.STICKS_LOST, mode, now_s)

    def _breached_fence(self) -> str | None:
        kinds = int(self.params["FENCE_TYPE"]) if self.params["FENCE_ENABLE"] > 0.0 and self.flight.flying else 0
        if kinds & _CIRCLE_FENCE and self.flight.home_distance_m > self.params["FENCE_RADIUS"]:
            return "Circle"
        if kinds & _ALTITUDE_FENCE and self.flight.height_m > self.params["FENCE_ALT_MAX"]:
            return "Max Alt"
        return None

    def _watch_fence(self, now_s: float) -> None:
        breached = self._breached_fence()
        if breached is not None and not self.outside_fence:
            self.say(Severity.NOTICE, f"{breached} fence breached")
            mode = _FENCE_ACTIONS.get(int(self.params["FENCE_ACTION"]))
            if mode is not None:
                self._act(Failsafe.GEOFENCE, mode, now_s)
        elif self.outside_fence and breached is None:
            self.say(Severity.NOTICE, "Fence breach cleared")
            if self.failsafe is Failsafe.GEOFENCE:
                self.failsafe = None
        self.outside_fence = breached is not None

    def _watch_estimator(self, now_s: float) -> None:
        if self.position_valid:
            if self.failsafe is Failsafe.POSITION_LOST:
                self.failsafe = None
                self.say(Severity.WARNING, "EKF Failsafe Cleared")
            return
        blind = self.mode not in (Mode.STABILIZE, Mode.ALTITUDE, Mode.LAND)
        if self.armed and self.failsafe is not Failsafe.POSITION_LOST and blind:
            self.say(Severity.CRITICAL, "EKF Failsafe")
            mode = _ESTIMATOR_ACTIONS.get(int(self.params["FS_EKF_ACTION"]))
            if mode is not None:
                self._act(Failsafe.POSITION_LOST, mode, now_s)

    def _watch_battery(self, now_s: float) -> None:
        mode = _BATTERY_ACTIONS.get(int(self.params["BATT_FS_LOW_ACT"]))
        if mode is None or self.battery_acted or not self.armed:
            return
        volts = battery_volts(self.battery_frac)
        if volts < self.params["BATT_LOW_VOLT"]:
            self.battery_acted = True
            self.say(Severity.WARNING, f"Battery 1 is low {volts:.2f}V used 0 mAh")
            self._act(Failsafe.BATTERY, mode, now_s)

    def _act(self, cause: Failsafe, mode: Mode, now_s: float) -> None:
        self.change_mode(mode)
        self.start_failsafe(cause, mode, now_s)

    def _disarm_on_ground(self, now_s: float) -> None:
        armed_t_s, landed_t_s = self.flight.armed_t_s, self.flight.landed_t_s
        if armed_t_s is None:
            return
        flown = landed_t_s > armed_t_s
        limit_s = _DISARM_AFTER_LANDING_S if flown else self.params["DISARM_DELAY"]
        if now_s - (landed_t_s if flown else armed_t_s) >= limit_s:
            self.do_disarm()
            self.taking_off = False

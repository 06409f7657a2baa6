"""What both personalities share: mode, arming, failsafe bookkeeping, the reply to a command."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum

from sitl_mocks.vehicle.flight import Behaviour, Flight, Speeds, Sticks
from sitl_mocks.vehicle.modes import Mode, Personality, Result, Severity
from sitl_mocks.vehicle.params import Parameters
from sitl_mocks.vehicle.setpoints import BadSetpointError, Setpoint

CUSTOM_MODE_FLAG = 1
GCS_TYPE = 6


class Failsafe(Enum):
    """Why the autopilot acts on its own."""

    SETPOINTS_LOST = "setpoints_lost"
    DATA_LINK = "data_link"
    GEOFENCE = "geofence"
    STICKS_LOST = "sticks_lost"
    POSITION_LOST = "position_lost"
    BATTERY = "battery"
    INJECTED = "injected"


def battery_volts(left_frac: float) -> float:
    """Voltage of a 4-cell pack by what is left of it."""
    return 13.2 + 3.6 * left_frac


@dataclass(frozen=True, slots=True)
class Text:
    """One STATUSTEXT."""

    severity: Severity
    text: str


@dataclass(slots=True)
class Autopilot(ABC):
    """The deciding part: commands and events in, mode and behaviour out. Times are of the vehicle's clock."""

    params: Parameters
    flight: Flight
    ready_after_s: float = 0.0
    sticks_present: bool = False
    mode: Mode = Mode.HOLD
    intended: Mode = Mode.HOLD
    armed: bool = False
    failsafe: Failsafe | None = None
    failsafe_t_s: float = 0.0
    ready: bool = False
    ready_t_s: float = float("inf")
    setpoint_t_s: float | None = None
    gcs_heartbeat_t_s: float | None = None
    gcs_lost: bool = False
    outside_fence: bool = False
    sticks_t_s: float | None = None  # the newest stick message; None = none yet, or a transmitter set by a test
    position_valid: bool = True  # what the estimator says of its position and velocity
    battery_frac: float = 1.0
    texts: list[Text] = field(default_factory=list)
    _speeds: Speeds | None = None
    _speeds_of: int = -1

    @property
    @abstractmethod
    def personality(self) -> Personality:
        """Whose behaviour this is."""

    @abstractmethod
    def execute(self, command: int, params: Sequence[float], now_s: float) -> Result | None:
        """Do a MAV_CMD; None = the autopilot sends no COMMAND_ACK."""

    @abstractmethod
    def watch(self, now_s: float) -> None:
        """Failsafes and timers, once a tick."""

    @abstractmethod
    def hear_sticks(self, sticks: Sticks, now_s: float) -> None:
        """MANUAL_CONTROL or RC channels came in."""

    @abstractmethod
    def make_speeds(self) -> Speeds:
        """Manoeuvre speeds from the parameters."""

    def speeds(self) -> Speeds:
        """Manoeuvre speeds, made anew only when a parameter has changed."""
        if self._speeds is None or self._speeds_of != self.params.changes:
            self._speeds, self._speeds_of = self.make_speeds(), self.params.changes
        return self._speeds

    @abstractmethod
    def behaviour(self) -> Behaviour:
        """What the airframe does now."""

    @abstractmethod
    def base_mode(self) -> int:
        """HEARTBEAT.base_mode."""

    @abstractmethod
    def system_status(self) -> int:
        """HEARTBEAT.system_status."""

    @abstractmethod
    def bad_setpoint(self, error: BadSetpointError) -> None:
        """What is said about a setpoint that is not taken."""

    def boot(self, now_s: float) -> None:
        """Power on at now_s; arming is possible ready_after_s later."""
        self.ready_t_s = now_s + self.ready_after_s
        self.ready = self.ready or self.ready_after_s <= 0.0

    def say(self, severity: Severity, text: str) -> None:
        """Queue a STATUSTEXT."""
        self.texts.append(Text(severity, text))

    def take_setpoint(self, setpoint: Setpoint) -> None:
        """A setpoint that parsed; whether it is flown is the mode's business."""
        self.flight.setpoint = setpoint
        self.setpoint_t_s = setpoint.t_s

    def setpoint_age_s(self, now_s: float) -> float:
        """Age of the newest setpoint in s, infinite if there was none."""
        return float("inf") if self.setpoint_t_s is None else now_s - self.setpoint_t_s

    def hear_gcs(self, system_id: int, now_s: float) -> None:
        """A HEARTBEAT of a ground station came in."""
        if self.counts_as_gcs(system_id):
            self.gcs_heartbeat_t_s = now_s

    def counts_as_gcs(self, system_id: int) -> bool:
        """Whether that station's heartbeats feed the GCS failsafe."""
        del system_id
        return True

    def pilot_sets_mode(self, mode: Mode) -> None:
        """Someone else, with sticks or another station, changes the mode: no ACK, no text on this link."""
        self.sticks_present = self.sticks_present or mode in (Mode.POSITION, Mode.ALTITUDE, Mode.STABILIZE)
        self.change_mode(mode)

    def change_mode(self, mode: Mode) -> None:
        """A mode wanted by a person: clears failsafes."""
        self.mode = self.intended = mode
        self.failsafe = None

    def start_failsafe(self, cause: Failsafe, mode: Mode | None, now_s: float) -> None:
        """The autopilot acts by itself; the intended mode stays what a person asked for."""
        self.failsafe, self.failsafe_t_s = cause, now_s
        if mode is not None:
            self.mode = mode

    def do_arm(self, now_s: float) -> None:
        """Arm: motors on, home is here (the origin stays where it was)."""
        if not self.armed:
            self.armed = True
            self.flight.armed_t_s = now_s

    def do_disarm(self) -> None:
        """Motors off."""
        self.armed = False
        self.flight.disarm()

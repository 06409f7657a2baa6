"""The mock vehicle: datagrams and a time in, datagrams out. No socket, no clock, no thread."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from sitl_mocks.dynamics import (
    ARDUPILOT,
    MAX_CATCH_UP_S,
    PX4,
    TICK_S,
    Airframe,
    Disturbance,
    Motion,
    Multicopter,
    Vec3,
)
from sitl_mocks.monitor import Truth
from sitl_mocks.vehicle.ardupilot import ArduPilot
from sitl_mocks.vehicle.autopilot import Autopilot, Failsafe
from sitl_mocks.vehicle.dispatch import Dispatcher
from sitl_mocks.vehicle.flight import Flight
from sitl_mocks.vehicle.link import Outbox, decode_datagram
from sitl_mocks.vehicle.modes import Landed, Mode, Personality, Result
from sitl_mocks.vehicle.params import Parameters
from sitl_mocks.vehicle.px4 import Px4
from sitl_mocks.vehicle.streams import HEARTBEAT, Streams, default_rates_hz, only
from sitl_mocks.vehicle.telemetry import BUILDERS, Home, View

_UNIX_START_S = 1.79e9


@dataclass(slots=True)
class Faults:
    """What a test may break, at any time. `refuse` maps a MAV_CMD to its result, None = no answer at all."""

    drop_uplink: float = 0.0  # share of the datagrams to the vehicle that are lost, 1 = all
    drop_downlink: float = 0.0
    stopped_streams: set[int] = field(default_factory=set)
    refuse: dict[int, Result | None] = field(default_factory=dict)
    frozen: bool = False  # the autopilot's process is stopped: datagrams wait in its socket
    gps_lost: bool = False


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the vehicle truly is, for a rendered camera. NED metres, rad, m/s, rad/s."""

    t_s: float
    position_ned_m: Vec3
    velocity_ned_mps: Vec3
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    yaw_rate_rps: float


class MockVehicle:
    """PX4 or ArduCopter as seen on the wire. Call `step` often (100-200 Hz), `receive` for each datagram.

    airborne_m: start armed and hovering that high. parameters: changes to the defaults by name.
    rates_hz: replaces the default streams (message id to Hz). ready_after_s: arming is refused that long after
    the first step.
    Raises ValueError for an unknown personality or parameter, or a height that is not positive.
    """

    def __init__(
        self,
        personality: Personality | str = Personality.PX4,
        *,
        home: Home | None = None,
        system_id: int = 1,
        component_id: int = 1,
        yaw_rad: float = 0.0,
        airborne_m: float | None = None,
        parameters: Mapping[str, float] | None = None,
        rates_hz: Mapping[int, float] | None = None,
        airframe: Airframe | None = None,
        disturbance: Disturbance | None = None,
        ready_after_s: float = 0.0,
        battery_frac: float = 1.0,
        seed: int = 0,
    ) -> None:
        self.personality = Personality(personality)
        self.home = home or Home()
        self.faults = Faults()
        self.battery_frac = battery_frac
        self._random = random.Random(seed)
        self.params = Parameters.defaults(self.personality, parameters or {})
        px4 = self.personality is Personality.PX4
        motion = Motion(yaw_rad=yaw_rad)
        body = Multicopter(airframe or (PX4 if px4 else ARDUPILOT), disturbance or Disturbance(), motion)
        pilot = Px4 if px4 else ArduPilot
        self.autopilot: Autopilot = pilot(self.params, Flight(body), ready_after_s=ready_after_s)
        self.streams = Streams(default_rates_hz(self.personality) if rates_hz is None else rates_hz)
        self.outbox = Outbox(system_id, component_id, self._random)
        self._dispatcher = Dispatcher(self)
        self._start_s: float | None = None
        self._ticks = 0
        self._waiting: list[bytes] = []
        self._announced = self.autopilot.mode
        self._was_frozen = False
        if airborne_m is not None:
            self._start_airborne(airborne_m)

    def _start_airborne(self, height_m: float) -> None:
        if not height_m > 0.0:
            raise ValueError(f"airborne_m must be a height above the ground, got {height_m}")
        flight = self.autopilot.flight
        flight.body.motion.position_ned_m = (0.0, 0.0, -height_m)
        flight.body.motion.on_ground = False
        flight.landed, flight.armed_t_s = Landed.IN_AIR, -math.inf
        self.autopilot.armed = self.autopilot.ready = True
        hover = Mode.HOLD if self.personality is Personality.PX4 else Mode.BRAKE
        self._announced = hover
        self.autopilot.change_mode(hover)

    # -- time and datagrams -------------------------------------------------------------------------------

    def step(self, now_s: float) -> list[bytes]:
        """Advance to now_s (s, any monotonic clock) and return the datagrams to be sent."""
        self._boot(now_s)
        if self.faults.frozen:
            self._was_frozen = True
            return []
        if self._was_frozen or now_s - self._now_s > MAX_CATCH_UP_S:
            self._was_frozen = False
            self._ticks = max(self._ticks, math.floor((now_s - self._boot_s) / TICK_S))
        waiting, self._waiting = self._waiting, []
        for datagram in waiting:
            self._dispatch(datagram, now_s)
        while self._now_s + TICK_S <= now_s + 1e-9:
            self._ticks += 1
            self._tick(self._now_s)
        return self.outbox.flush(now_s, self.faults.drop_downlink)

    def receive(self, datagram: bytes, now_s: float) -> list[bytes]:
        """Take one datagram that arrived at now_s; returns what the vehicle answers at once."""
        self._boot(now_s)
        lost = self.faults.drop_uplink > 0.0 and self._random.random() < self.faults.drop_uplink
        if lost:
            return []
        if self.faults.frozen:
            self._waiting.append(datagram)
            return []
        self._dispatch(datagram, now_s)
        self._announce(now_s)
        return self.outbox.flush(now_s, self.faults.drop_downlink)

    def _boot(self, now_s: float) -> None:
        if self._start_s is None:
            self._start_s = now_s
            self.autopilot.boot(now_s)

    @property
    def _now_s(self) -> float:
        return self._boot_s + self._ticks * TICK_S

    @property
    def _boot_s(self) -> float:
        return 0.0 if self._start_s is None else self._start_s

    def _dispatch(self, datagram: bytes, now_s: float) -> None:
        for message in decode_datagram(datagram):
            self._dispatcher.handle(message, now_s)

    def _tick(self, now_s: float) -> None:
        pilot = self.autopilot
        pilot.watch(now_s)
        pilot.flight.tick(pilot.behaviour(), now_s, pilot.speeds())
        self._announce(now_s)
        numbers = only(self.streams.due(now_s), self.faults.stopped_streams)
        if numbers:
            view = self.view(now_s)
            for number in numbers:
                self.outbox.put(BUILDERS[number](view), now_s)

    def _announce(self, now_s: float) -> None:
        """What goes out on an event: texts, and ArduCopter's heartbeat on a mode change."""
        pilot = self.autopilot
        for text in pilot.texts:
            self.outbox.put_text(text, now_s)
        pilot.texts.clear()
        if pilot.mode is not self._announced:
            self._announced = pilot.mode
            if self.personality is Personality.ARDUPILOT and HEARTBEAT not in self.faults.stopped_streams:
                self.outbox.put(BUILDERS[HEARTBEAT](self.view(now_s)), now_s)

    # -- what a test or a simulator sees and does -----------------------------------------------------------

    def view(self, now_s: float) -> View:
        """The state the telemetry messages are built from."""
        boot_s = now_s - self._boot_s
        gps_ok = not self.faults.gps_lost
        return View(self.autopilot, self.home, boot_s, self.battery_frac, gps_ok, _UNIX_START_S + boot_s)

    def pose(self) -> Pose:
        """The true pose at the newest tick, for the camera."""
        m = self.autopilot.flight.body.motion
        return Pose(
            self._now_s, m.position_ned_m, m.velocity_ned_mps, m.roll_rad, m.pitch_rad, m.yaw_rad, m.yaw_rate_rps
        )

    def truth(self) -> Truth:
        """What the wire monitor judges the traffic by."""
        pilot = self.autopilot
        motion = pilot.flight.body.motion
        external = pilot.mode is Mode.EXTERNAL
        return Truth(external, pilot.armed, pilot.flight.flying, motion.position_ned_m, motion.yaw_rad)

    def pilot_sets_mode(self, mode: Mode) -> None:
        """The pilot, or another station, changes the mode: nothing is sent but the new mode itself."""
        self.autopilot.pilot_sets_mode(mode)

    def start_failsafe(self, mode: Mode) -> None:
        """The vehicle decides by itself, for example RETURN on a low battery: system_status 5."""
        self.autopilot.start_failsafe(Failsafe.INJECTED, mode, self._now_s)

    def message(self, number: int, now_s: float) -> Any:
        """One telemetry message by its id, now."""
        return BUILDERS[number](self.view(now_s))

"""The mock vehicle: datagrams and a time in, datagrams out. No socket, no clock, no thread."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
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
)
from sitl_mocks.monitor import Truth
from sitl_mocks.vehicle.ardupilot import ArduPilot
from sitl_mocks.vehicle.autopilot import Autopilot, Failsafe
from sitl_mocks.vehicle.dispatch import Dispatcher
from sitl_mocks.vehicle.faults import Faults, without_numbers
from sitl_mocks.vehicle.flight import Flight, Sticks
from sitl_mocks.vehicle.gimbal import MockGimbal
from sitl_mocks.vehicle.link import Outbox
from sitl_mocks.vehicle.modes import Landed, Mode, Personality
from sitl_mocks.vehicle.params import Parameters
from sitl_mocks.vehicle.pose import Pose
from sitl_mocks.vehicle.px4 import Px4
from sitl_mocks.vehicle.second_link import SecondLink
from sitl_mocks.vehicle.signing import Signing
from sitl_mocks.vehicle.streams import (
    GLOBAL_POSITION_INT,
    HEARTBEAT,
    LOCAL_POSITION_NED,
    Streams,
    default_rates_hz,
)
from sitl_mocks.vehicle.telemetry import BUILDERS, Home, View

UNIX_START_S = 1.79e9


class MockVehicle:
    """PX4 or ArduCopter as seen on the wire. Call `step` often (100-200 Hz), `receive` for each datagram.

    airborne_m: start armed and hovering that high. parameters: changes to the defaults by name.
    rates_hz: replaces the default streams (message id to Hz); fewer are cheaper. ready_after_s: arming is refused
    that long after boot. signing_key: 32 bytes, it then signs and believes only what is signed. unix_start_s: the wall
    clock at the first step, which signatures are stamped by; `run_udp` sets it to the real one.
    tick_s: of the simulation; 10 ms halves the cost.
    Raises ValueError for an unknown personality or parameter, a height that is not positive, or a bad key.
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
        signing_key: bytes | None = None,
        unix_start_s: float | None = None,
        gimbal: MockGimbal | None = None,
        tick_s: float = TICK_S,
        seed: int = 0,
    ) -> None:
        self.personality = Personality(personality)
        self.home = home or Home()
        self.faults = Faults()
        self.battery_frac = battery_frac
        self.rc_sticks: Sticks | None = None  # a transmitter that is on; None again = out of reach
        self.params = Parameters.defaults(self.personality, parameters or {})
        self.signing = Signing(signing_key, self.personality)
        self._px4 = self.personality is Personality.PX4
        self._airframe = airframe or (PX4 if self._px4 else ARDUPILOT)
        self._disturbance = disturbance or Disturbance()
        self._ready_after_s = ready_after_s
        self._rates_hz = default_rates_hz(self.personality) if rates_hz is None else rates_hz
        self.unix_start_s = unix_start_s
        self._tick_s = tick_s
        self._random = random.Random(seed)
        self.outbox = Outbox(system_id, component_id, self._random, self.signing, self.faults)
        self._dispatcher = Dispatcher(self, self.outbox)
        self.gimbal = gimbal
        if gimbal is not None:
            gimbal.attach(self.outbox)
        self._epoch_s: float | None = None  # when the first step was; unix_start_s belongs to it
        self._power_on(Motion(yaw_rad=yaw_rad))
        if airborne_m is not None:
            self._start_airborne(airborne_m)

    def _power_on(self, motion: Motion) -> None:
        pilot = Px4 if self._px4 else ArduPilot
        flight = Flight(Multicopter(self._airframe, self._disturbance, motion, tick_s=self._tick_s))
        self.autopilot: Autopilot = pilot(self.params, flight, ready_after_s=self._ready_after_s)
        self.streams = Streams(self._rates_hz)
        self.outbox.restart()
        self._start_s: float | None = None
        self._silent_until_s = -math.inf
        self._ticks = 0
        self._waiting: list[bytes] = []
        self._announced = self.autopilot.mode
        self._was_frozen = False
        self._gps_lost_t_s: float | None = None
        self._stale: dict[int, Any] = {}

    def _start_airborne(self, height_m: float) -> None:
        if not height_m > 0.0:
            raise ValueError(f"airborne_m must be a height above the ground, got {height_m}")
        flight = self.autopilot.flight
        flight.body.motion.position_ned_m = (0.0, 0.0, -height_m)
        flight.body.motion.on_ground = False
        flight.landed, flight.armed_t_s = Landed.IN_AIR, -math.inf
        self.autopilot.armed = self.autopilot.ready = True
        hover = Mode.HOLD if self._px4 else Mode.BRAKE
        self._announced = hover
        self.autopilot.change_mode(hover)

    def reboot(self, now_s: float, silent_s: float = 2.0) -> None:
        """Restart the autopilot at now_s: disarmed on the ground below, everything asked for is forgotten.

        Parameters and the signing time stamp survive. Silent for silent_s (s), then the clock of its boot is at zero.
        """
        motion = self.autopilot.flight.body.motion
        north, east, _ = motion.position_ned_m
        self._power_on(Motion((north, east, 0.0), yaw_rad=motion.yaw_rad))
        self._silent_until_s = now_s + silent_s

    # -- time and datagrams -------------------------------------------------------------------------------

    def step(self, now_s: float) -> list[bytes]:
        """Advance to now_s (s, any monotonic clock) and return the datagrams to be sent."""
        if not self._boot(now_s):
            return []
        if self.faults.frozen:
            self._was_frozen = True
            return []
        if self._was_frozen or now_s - self._now_s > MAX_CATCH_UP_S:
            self._was_frozen = False
            self._ticks = max(self._ticks, math.floor((now_s - self._boot_s) / self._tick_s))
        waiting, self._waiting = self._waiting, []
        for datagram in waiting:
            self._dispatch(datagram, now_s)
        boot_s, tick_s = self._boot_s, self._tick_s
        while boot_s + (self._ticks + 1) * tick_s <= now_s + 1e-9:
            self._ticks += 1
            self._tick(boot_s + self._ticks * tick_s)
        return self._flush(now_s)

    def receive(self, datagram: bytes, now_s: float) -> list[bytes]:
        """Take one datagram that arrived at now_s; returns what the vehicle answers at once."""
        if not self._boot(now_s):
            return []
        lost = self.faults.drop_uplink > 0.0 and self._random.random() < self.faults.drop_uplink
        if lost:
            return []
        if self.faults.frozen:
            self._waiting.append(datagram)
            return []
        self._dispatch(datagram, now_s)
        self.announce(now_s)
        return self._flush(now_s)

    def second_link(self, *, forwarded: bool = False) -> SecondLink:
        """Another way in, for another ground station; forwarded: heard on the first link too."""
        return SecondLink(self, forwarded=forwarded)

    def unix_s(self, now_s: float) -> float:
        """The vehicle's wall clock."""
        start_s = UNIX_START_S if self.unix_start_s is None else self.unix_start_s
        return start_s + now_s - (now_s if self._epoch_s is None else self._epoch_s)

    def _boot(self, now_s: float) -> bool:
        """Whether it is running; the first time it is, its boot clock starts."""
        if self._start_s is not None:
            return True
        if now_s < self._silent_until_s:
            return False
        self._epoch_s = now_s if self._epoch_s is None else self._epoch_s
        self._start_s = now_s
        self.autopilot.boot(now_s)
        return True

    @property
    def _now_s(self) -> float:
        return self._boot_s + self._ticks * self._tick_s

    @property
    def _boot_s(self) -> float:
        return 0.0 if self._start_s is None else self._start_s

    def _dispatch(self, datagram: bytes, now_s: float) -> None:
        for message in self.outbox.read(datagram, self.unix_s(now_s)):
            if self.gimbal is None or not self.gimbal.handle(message, now_s):
                self._dispatcher.handle(message, now_s)

    def _flush(self, now_s: float) -> list[bytes]:
        sent = self.outbox.flush(now_s, self.unix_s(now_s))
        return sent if self.gimbal is None else sent + self.gimbal.flush(now_s, self.unix_s(now_s))

    def _tick(self, now_s: float) -> None:
        pilot = self.autopilot
        self._sense(now_s)
        pilot.watch(now_s)
        pilot.flight.tick(pilot.behaviour(), now_s, pilot.speeds())
        if self.gimbal is not None:
            self.gimbal.tick(now_s, pilot.flight.body.motion)
        self.announce(now_s)
        due = self.streams.due(now_s)
        if due:
            view = self.view(now_s)
            for number in due:
                if number not in self.faults.stopped_streams and self._can_tell(number):
                    self.outbox.put(self._message(number, view), now_s)

    def _sense(self, now_s: float) -> None:
        """What the autopilot learns from outside: position, battery, the transmitter."""
        pilot = self.autopilot
        pilot.battery_frac = self.battery_frac
        if not self.faults.gps_lost:
            self._gps_lost_t_s = None
        elif self._gps_lost_t_s is None:
            self._gps_lost_t_s = now_s
        lost_t_s = self._gps_lost_t_s
        pilot.position_valid = lost_t_s is None or now_s - lost_t_s < self.faults.dead_reckoning_s
        if self.rc_sticks is not None:
            pilot.hear_sticks(self.rc_sticks, now_s)

    def _can_tell(self, number: int) -> bool:
        """An invalid position is not sent; ArduCopter goes on with the global one."""
        if self.autopilot.position_valid:
            return True
        return number != LOCAL_POSITION_NED and not (self._px4 and number == GLOBAL_POSITION_INT)

    def _message(self, number: int, view: View) -> Any:
        faults = self.faults
        if number in faults.stale_streams and number in self._stale:
            return self._stale[number]
        message = BUILDERS[number](view)
        self._stale[number] = message
        return without_numbers(message) if number in faults.nan_streams else message

    def announce(self, now_s: float) -> None:
        """What goes out on an event: texts, and ArduCopter's heartbeat on a mode change."""
        pilot = self.autopilot
        for text in pilot.texts:
            self.outbox.put_text(text, now_s)
        pilot.texts.clear()
        if pilot.mode is not self._announced:
            self._announced = pilot.mode
            if not self._px4 and HEARTBEAT not in self.faults.stopped_streams:
                self.outbox.put(BUILDERS[HEARTBEAT](self.view(now_s)), now_s)

    # -- what a test or a simulator sees and does -----------------------------------------------------------

    def view(self, now_s: float) -> View:
        """The state the telemetry messages are built from."""
        boot_s = now_s - self._boot_s
        return View(self.autopilot, self.home, boot_s, self.unix_s(now_s), self.faults)

    def pose(self) -> Pose:
        """The true pose at the newest tick, for the camera."""
        m, camera = self.autopilot.flight.body.motion, None if self.gimbal is None else self.gimbal.rpy_rad
        attitude = (m.roll_rad, m.pitch_rad, m.yaw_rad)
        return Pose(self._now_s, m.position_ned_m, m.velocity_ned_mps, *attitude, m.yaw_rate_rps, camera)

    def truth(self) -> Truth:
        """What the wire monitor judges the traffic by."""
        pilot = self.autopilot
        motion = pilot.flight.body.motion
        by_target = pilot.mode is Mode.FOLLOW
        external = by_target or pilot.mode is Mode.EXTERNAL
        return Truth(external, pilot.armed, pilot.flight.flying, motion.position_ned_m, motion.yaw_rad, by_target)

    def pilot_sets_mode(self, mode: Mode) -> None:
        """The pilot, or another station, changes the mode: nothing is sent but the new mode itself."""
        self.autopilot.pilot_sets_mode(mode)

    def start_failsafe(self, mode: Mode) -> None:
        """The vehicle decides by itself, for example RETURN on a low battery: system_status 5."""
        self.autopilot.start_failsafe(Failsafe.INJECTED, mode, self._now_s)

    def message(self, number: int, now_s: float) -> Any:
        """One telemetry message by its id, now."""
        return BUILDERS[number](self.view(now_s))

"""Vehicle, link, camera and judge around the real flight, advanced in steps of 10 ms of fake time."""

from __future__ import annotations

import asyncio
import math
import random
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

from control.engagement import State
from gcs.autopilot.actions import VehicleActions
from gcs.autopilot.mode_control import ModeControl
from gcs.config import CameraConfig, Config
from gcs.flight import Flight, Link
from gcs.keys import SigningKey
from gcs.lockstep.exit import Exit
from gcs.lockstep.eyes import HFOV_RAD, MOUNT_PITCH_RAD, Eyes, LockstepVision, ModelTracker, NoSource
from gcs.lockstep.loop import LockstepLoop
from gcs.signing import Signing
from gcs.signing_time import SigningTime
from gcs.telemetry import Telemetry
from gcs.transport import Peer, Received
from gcs.wire import Wire
from sitl_mocks.link_faults import Conditions, OneWay
from sitl_mocks.monitor import MonitorLimits, Vec3, WireMonitor
from sitl_mocks.vehicle import MockVehicle, Personality
from sitl_mocks.vehicle.params import PREPARED
from sitl_mocks.vehicle.streams import HEARTBEAT

STEP_S = 0.01
DELAY_S = 0.01  # each way
VEHICLE_PEER: Peer = ("vehicle", 14580)
_RECENT_S = 0.25
_KEY, UNIX_S = bytes(range(1, 33)), 1.79e9
_ENDED = (State.RELEASED, State.TAKEN_OVER)


CAMERA = CameraConfig(hfov_deg=math.degrees(HFOV_RAD), mount_rpy_deg=(0.0, math.degrees(MOUNT_PITCH_RAD), 0.0))
# The vehicle takes datagrams in steps of 10 ms, which makes a step of velocity look that much quicker than it is; the
# gate's own limit of 4 m/s² is judged at the exit.
LIMITS = MonitorLimits(
    accel_max_mps2=5.0,
    confirmation_needed=True,
    fence_radius_m=150.0,
    height_min_m=3.0,
    height_max_m=60.0,
    confirmation_lasts_s=3.0,
)


@dataclass(frozen=True, slots=True)
class Setup:
    """What a flight begins with."""

    seed: int
    personality: Personality
    config: Config = field(default_factory=lambda: Config(camera=CAMERA))
    height_m: float | None = 9.0  # None: on the ground, disarmed
    limits: MonitorLimits = field(default_factory=lambda: LIMITS)
    parameters: dict[str, float] = field(default_factory=dict)  # on top of the prepared ones
    signed: bool = False  # MAVLink 2 signing, both ways


@dataclass(slots=True)
class Target:
    """Walks on level ground with a weave; a fault may change how."""

    position_ned_m: Vec3
    speed_mps: float = 0.0
    heading_rad: float = 0.0
    weave_rad: float = 0.35

    def step(self, now_s: float) -> None:
        """Advance by STEP_S."""
        heading = self.heading_rad + self.weave_rad * math.sin(0.9 * now_s)
        north, east, down = self.position_ned_m
        length_m = self.speed_mps * STEP_S
        self.position_ned_m = (north + length_m * math.cos(heading), east + length_m * math.sin(heading), down)


class StationEnd:
    """The station's `Transport`: what it sends goes out on the way up."""

    status, connections = "lockstep", 1

    def __init__(self, send: Callable[[bytes], bool], received: Received) -> None:
        self._send = send
        self.received = received

    def send(self, data: bytes) -> bool:
        """Always taken."""
        return self._send(data)

    def reply_to(self, peer: Peer) -> None:
        """There is one vehicle."""

    async def close(self) -> None:
        """Nothing is open."""


class World:
    """Call `step` every STEP_S; faults change its parts."""

    def __init__(self, loop: LockstepLoop, setup: Setup) -> None:
        self.loop = loop
        self.setup = setup
        self.random = random.Random(setup.seed * 7919 + 17)
        self.vehicle = MockVehicle(
            setup.personality,
            airborne_m=setup.height_m,
            parameters={**PREPARED[setup.personality], **setup.parameters},
            rates_hz={HEARTBEAT: 1.0},
            seed=setup.seed,
            signing_key=_KEY if setup.signed else None,
            unix_start_s=UNIX_S,
        )
        self.monitor = WireMonitor(setup.limits)
        self.exit = Exit()
        self.up = OneWay(Conditions(delay_s=DELAY_S), seed=setup.seed * 2 + 1)
        self.down = OneWay(Conditions(delay_s=DELAY_S), seed=setup.seed * 2 + 2)
        self.target = Target((15.5, self.random.uniform(-1.5, 1.5), -0.8))
        self.target_heading_rad: float | None = None  # where it goes once confirmed; None: somewhere away
        self.said: list[str] = []
        self.frozen = False  # the station's process stands still: what comes in waits
        self.dead = False  # it is gone
        self.cause_s = math.inf  # when the fault came
        self.bound_s: float | None = None
        self.silent = False  # the bound is for setpoints of any kind
        self.engaged_before = False
        self.was_moving = False
        self.undo: list[Callable[[], None]] = []
        self.hooks: list[Callable[[float], None]] = []
        self.station: StationEnd | None = None
        self._backlog: list[tuple[bytes, Peer]] = []
        self.eyes = Eyes(random.Random(setup.seed + 5))
        self.wire = Wire.over(self._transport, clock=loop, signing=self._signing() if setup.signed else None)
        self.telemetry = Telemetry(self.wire, loop)
        modes = ModeControl(self.wire, self.telemetry, loop)
        link = Link(self.wire, self.telemetry, modes, cast(VehicleActions, None))
        source, tracker = NoSource(), ModelTracker(self.eyes, loop)
        self.flight = Flight(link, source, tracker, setup.config, loop, say=self.said.append)
        self.vision = LockstepVision(self.eyes, loop, self.flight.saw)
        self.flight.vision = self.vision

    def _signing(self) -> Signing:
        folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self.undo.append(folder.cleanup)
        times = SigningTime(Path(folder.name) / "time", self.loop, UNIX_S)
        return Signing(SigningKey(_KEY), times, self.loop)

    def _transport(self, received: Received) -> StationEnd:
        self.station = StationEnd(self._leave, received)
        return self.station

    def _leave(self, data: bytes) -> bool:
        if self.dead:
            return False
        now_s = self.loop.time()
        self.exit.note(now_s, data)
        self.up.put(data, now_s)
        return True

    @property
    def px4(self) -> bool:
        """Which autopilot it is."""
        return self.setup.personality is Personality.PX4

    async def run(self) -> None:
        """Go on until cancelled."""
        due_s = self.loop.time()
        while True:
            self.step(self.loop.time())
            due_s = max(due_s + STEP_S, self.loop.time())  # what a stall has stepped is not stepped again
            await _sleep_until(self.loop, due_s)

    def step(self, now_s: float) -> None:
        """Everything but the station itself."""
        for hook in tuple(self.hooks):
            hook(now_s)
        self.target.step(now_s)
        self.down_from_vehicle(self.vehicle.step(now_s), now_s)
        for data in self.up.take(now_s):
            self.monitor.feed(now_s, data, self.vehicle.truth())
            self.down_from_vehicle(self.vehicle.receive(data, now_s), now_s)
        self.monitor.tick(now_s, self.vehicle.truth())
        self.vision.shoot(now_s, self.target.position_ned_m, self.vehicle.pose())
        self._backlog.extend((data, VEHICLE_PEER) for data in self.down.take(now_s))
        if not (self.frozen or self.dead):
            self.hand_over(now_s)
        tick = self.flight.tick
        self.exit.ended = self.exit.ended or (tick is not None and tick.output.state in _ENDED)

    def down_from_vehicle(self, datagrams: list[bytes], now_s: float | None = None) -> None:
        """What the vehicle sends goes on its way."""
        now_s = self.loop.time() if now_s is None else now_s
        for data in datagrams:
            self.down.put(data, now_s)

    def hand_over(self, now_s: float) -> None:
        """What waits in the station's sockets is read."""
        backlog, self._backlog = self._backlog, []
        assert self.station is not None
        for data, peer in backlog:
            self.station.received(data, peer)
        self.vision.hand_over(now_s)

    def caused(self, now_s: float) -> None:
        """The fault's bound counts from now on."""
        self.cause_s = now_s
        self.engaged_before = self.flight.control.is_engaged
        self.was_moving = self.exit.any_moving(now_s - _RECENT_S, now_s)
        if self.bound_s is None:
            return
        by_s = now_s + self.bound_s + self.up.conditions.delay_s + 2 * STEP_S
        if self.silent:
            self.monitor.silent_by_s = by_s
        else:
            self.monitor.still_by_s = by_s

    def rested(self) -> bool:
        """Nothing has moved the vehicle since the fault: the control law was not asked."""
        return not self.exit.any_moving(self.cause_s, math.inf)

    def cause_is_motion(self) -> None:
        """A fault that is there from the start harms from the first moving setpoint on."""
        self.caused_when(lambda: self.exit.last_s(moving=True) is not None)

    def caused_when(self, condition: Callable[[], bool]) -> None:
        """The fault's bound counts from when this is true."""

        def watch(now_s: float) -> None:
            if condition():
                self.caused(now_s)
                self.hooks.remove(watch)

        self.hooks.append(watch)

    def inject(self, data: bytes, peer: Peer = VEHICLE_PEER) -> None:
        """A datagram from somebody, straight into the station's socket."""
        self._backlog.append((data, peer))

    def stall(self, seconds: float) -> None:
        """The station's whole process stands still for so long; the world goes on."""
        self.frozen = True
        now_s = self.loop.time()
        end_s = now_s + seconds
        while now_s + STEP_S <= end_s:
            now_s += STEP_S
            self.loop.stall(now_s)
            self.step(now_s)
        self.frozen = False
        self.hand_over(self.loop.time())


async def _sleep_until(loop: LockstepLoop, due_s: float) -> None:
    future: asyncio.Future[None] = loop.create_future()
    handle = loop.call_at(due_s, _wake, future)
    try:
        await future
    finally:
        handle.cancel()


def _wake(future: asyncio.Future[None]) -> None:
    if not future.done():
        future.set_result(None)

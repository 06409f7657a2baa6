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
from gcs.lockstep.eyes import Eyes, LockstepVision, ModelTracker, NoSource
from gcs.lockstep.loop import LockstepLoop
from gcs.lockstep.target import STEP_S, Target, Walker
from gcs.signing import Signing
from gcs.signing_time import SigningTime
from gcs.telemetry import Telemetry
from gcs.transport import Peer, Received
from gcs.wire import Wire
from sitl_mocks.dynamics import TICK_S, Airframe, Disturbance
from sitl_mocks.lens import Lens
from sitl_mocks.link_faults import Conditions, OneWay
from sitl_mocks.monitor import MonitorLimits, WireMonitor
from sitl_mocks.vehicle import MockGimbal, MockVehicle, Personality
from sitl_mocks.vehicle.params import PREPARED
from sitl_mocks.vehicle.streams import ATTITUDE, HEARTBEAT

DELAY_S = 0.01  # each way
GLASS_S = 0.06
VEHICLE_PEER: Peer = ("vehicle", 14580)
_KEY, UNIX_S = bytes(range(1, 33)), 1.79e9
_ENDED = (State.RELEASED, State.TAKEN_OVER)


def camera_of(lens: Lens, glass_delay_s: float | None = GLASS_S) -> CameraConfig:
    """What a station should know of this lens."""
    mount_rpy_deg = (0.0, math.degrees(lens.mount_pitch_rad), 0.0)
    return CameraConfig(hfov_deg=math.degrees(lens.hfov_rad), mount_rpy_deg=mount_rpy_deg, glass_delay_s=glass_delay_s)


CAMERA = camera_of(Lens())
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
    """What a flight begins with.

    config: what the station believes, its camera too; lens: the camera as it is. link: both ways. attitude_rate_hz:
    more than so many ATTITUDE a second the vehicle does not send, whatever it is asked.
    """

    seed: int
    personality: Personality = Personality.PX4
    config: Config = field(default_factory=lambda: Config(camera=CAMERA))
    height_m: float | None = 9.0  # None: on the ground, disarmed
    limits: MonitorLimits = field(default_factory=lambda: LIMITS)
    parameters: dict[str, float] = field(default_factory=dict)  # on top of the prepared ones
    signed: bool = False  # MAVLink 2 signing, both ways
    heading_rad: float = 0.0
    lens: Lens = field(default_factory=Lens)
    link: Conditions = field(default_factory=lambda: Conditions(delay_s=DELAY_S))
    airframe: Airframe | None = None  # None: the personality's own
    disturbance: Disturbance = field(default_factory=Disturbance)
    attitude_rate_hz: float | None = None
    tick_s: float = TICK_S  # of the vehicle's dynamics
    gimbal: Callable[[], MockGimbal] | None = None  # makes one for the camera; the lens then needs no mount


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
    """Call `step` every STEP_S, or `run` as a task; its parts may be changed at any time.

    target: None is a `Walker` some 15 m ahead that stands still. eyes: the camera and what it sees; None: a camera
    with the setup's lens that sees the target and nothing else.
    """

    def __init__(
        self, loop: LockstepLoop, setup: Setup, target: Target | None = None, eyes: Eyes | None = None
    ) -> None:
        self.loop = loop
        self.setup = setup
        self.random = random.Random(setup.seed * 7919 + 17)
        self.vehicle = _vehicle(setup)
        self.monitor = WireMonitor(setup.limits)
        self.exit = Exit()
        self.up = OneWay(setup.link, seed=setup.seed * 2 + 1)
        self.down = OneWay(setup.link, seed=setup.seed * 2 + 2)
        self.target = target or Walker((15.5, self.random.uniform(-1.5, 1.5), -0.8))
        self.said: list[str] = []
        self.undo: list[Callable[[], None]] = []  # to be called when the flight is over
        self.hooks: list[Callable[[float], None]] = []  # called with the time, before each step
        self.station: StationEnd | None = None
        self.backlog: list[tuple[bytes, Peer]] = []
        self.eyes = eyes or Eyes(random.Random(setup.seed + 5), lens=setup.lens)
        signing, backend = self._signing() if setup.signed else None, setup.config.vehicle.backend
        self.wire = Wire.over(self._transport, clock=loop, signing=signing, backend=backend)
        self.telemetry = Telemetry(self.wire, loop)
        modes = ModeControl(self.wire, self.telemetry, loop)
        link = Link(self.wire, self.telemetry, modes, cast(VehicleActions, None))
        source, tracker = NoSource(setup.lens), self.eyes.tracker or ModelTracker(self.eyes, loop)
        self.flight = Flight(link, source, tracker, setup.config, loop, say=self.said.append)
        camera = setup.config.camera
        self.vision = LockstepVision(self.eyes, tracker, loop, self.flight, glass_delay_s=camera.assumed_glass_delay_s)
        self.flight.vision = self.vision

    def _signing(self) -> Signing:
        folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self.undo.append(folder.cleanup)
        times = SigningTime(Path(folder.name) / "time", self.loop, UNIX_S)
        return Signing(SigningKey(_KEY), times, self.loop)

    def _transport(self, received: Received) -> StationEnd:
        self.station = StationEnd(self.leave, received)
        return self.station

    def leave(self, data: bytes) -> bool:
        """A datagram of the station goes on its way."""
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
        self.vision.shoot(now_s, self.target.position_ned_m, self.vehicle.pose().of_camera)
        self.backlog.extend((data, VEHICLE_PEER) for data in self.down.take(now_s))
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
        backlog, self.backlog = self.backlog, []
        assert self.station is not None
        for data, peer in backlog:
            self.station.received(data, peer)
        self.vision.hand_over(now_s)

    def inject(self, data: bytes, peer: Peer = VEHICLE_PEER) -> None:
        """A datagram from somebody, straight into the station's socket."""
        self.backlog.append((data, peer))


def _vehicle(setup: Setup) -> MockVehicle:
    vehicle = MockVehicle(
        setup.personality,
        airborne_m=setup.height_m,
        parameters={**PREPARED[setup.personality], **setup.parameters},
        rates_hz={HEARTBEAT: 1.0},
        seed=setup.seed,
        signing_key=_KEY if setup.signed else None,
        unix_start_s=UNIX_S,
        yaw_rad=setup.heading_rad,
        airframe=setup.airframe,
        disturbance=setup.disturbance,
        tick_s=setup.tick_s,
        gimbal=setup.gimbal() if setup.gimbal is not None else None,
    )
    if setup.attitude_rate_hz is not None:
        vehicle.streams.least_interval_s[ATTITUDE] = 1.0 / setup.attitude_rate_hz
    return vehicle


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

"""The whole flight over real UDP to the mock vehicle, MAVSDK beside us; a tracker that is fed the truth.

What arrives at the vehicle is judged by its own monitor, which knows none of our code.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from control.engagement import Action, Cause, State
from control.types import VehicleMode
from gcs.app import make_flight, open_link
from gcs.audit import Audit
from gcs.clock import MonotonicClock
from gcs.config import CameraConfig, Config
from gcs.errors import GcsError
from gcs.flight import Flight
from gcs.flight_control import Tick
from gcs.flight_orders import Orders, RefusedError
from gcs.flight_view import Sighting
from gcs.operator.orders import Abort, Acknowledge, Confirm, Land, Select
from gcs.video import Frame
from gcs.video.frame import Image
from sitl_mocks.monitor import WireMonitor
from sitl_mocks.vehicle import PREPARED, MockVehicle, Mode, Personality
from sitl_mocks.vehicle.server import run_udp
from tests.gcs.flight_rig import box_of
from tests.gcs.wire_peer import free_port
from tracker.box import Box, TrackResult

pytestmark = pytest.mark.alone  # real flights in real time want the machine to themselves

BOTH = pytest.mark.parametrize("personality", ["px4", "ardupilot"])
SEEN_HEIGHT_M = 9.0


class TruthCamera:
    """A live source of blank pictures; each carries its number, under which the true box is kept."""

    name, is_live, fps, size, frame_count, problem, ended = "truth", True, 20.0, (640, 480), None, None, False

    def __init__(self, mock: MockVehicle) -> None:
        self._mock = mock
        self._count = 0
        self.boxes: dict[int, Box | None] = {}
        self.begun_s = time.monotonic()

    def read(self, timeout_s: float | None = None) -> Frame | None:
        time.sleep(0.05)
        self._count += 1
        pose = self._mock.pose()
        seconds = time.monotonic() - self.begun_s
        target = (16.0 + 1.5 * seconds, 2.0 * math.sin(seconds / 2), 0.0)
        self.boxes[self._count] = box_of(target, pose.position_ned_m, pose.yaw_rad, pose.roll_rad, pose.pitch_rad)
        image = np.zeros((480, 640, 3), np.uint8)
        image[:2] = np.frombuffer(self._count.to_bytes(2, "little"), np.uint8)[:, None, None]
        now_s = time.monotonic()
        return Frame(self._count, image, now_s, now_s)

    def close(self) -> None:
        pass


class TruthTracker:
    """Reads the number off the picture and looks the box up."""

    def __init__(self, camera: TruthCamera) -> None:
        self._camera = camera
        self.blind = False

    def init(self, frame_bgr: Image, box: Box) -> None:
        pass

    def update(self, frame_bgr: Image) -> TrackResult:
        number = int.from_bytes(frame_bgr[:2, 0, 0].tobytes(), "little")
        box = self._camera.boxes[number]
        if box is None or self.blind:
            return TrackResult(Box(1.0, 1.0, 10.0, 10.0), 0.0, 0.0)
        return TrackResult(box, 1.0, 0.95)


@dataclass
class Session:
    """A running flight and the vehicle at the other end."""

    mock: MockVehicle
    flight: Flight
    orders: Orders
    tracker: TruthTracker
    monitor: WireMonitor
    running: asyncio.Task[None]
    said: list[str] = field(default_factory=list)

    async def begin(self) -> None:
        """Select and confirm."""
        telemetry = self.flight.link.telemetry
        assert await telemetry.wait_for(lambda s: s.armed and s.in_air and s.position_t_s is not None, 10.0)
        await asyncio.sleep(2.5)  # for the attitude rate to be known
        await self.orders.perform(Select(Box(320.0, 240.0, 40.0, 40.0)))
        await asyncio.sleep(0.5)
        await self.confirm()

    async def confirm(self) -> str:
        """Once more where the machine that runs the tests was busy a moment ago, which refuses it for two seconds."""
        try:
            return await self.orders.perform(Confirm())
        except RefusedError as error:
            if Cause.OWN_LAG.value not in str(error):
                raise
        await asyncio.sleep(2.5)
        return await self.orders.perform(Confirm())

    async def reaches(self, state: State, timeout_s: float = 5.0) -> Tick:
        async with asyncio.timeout(timeout_s):
            while (tick := await self.flight.next_tick()).output.state is not state:
                pass
        return tick

    async def mode(self, mode: Mode, timeout_s: float = 5.0) -> None:
        async with asyncio.timeout(timeout_s):
            while self.mock.autopilot.mode is not mode:
                await asyncio.sleep(0.02)


@contextlib.asynccontextmanager
async def session(
    personality: str = "px4", parameters: Mapping[str, float] | None = None, accepted: tuple[str, ...] = ()
) -> AsyncIterator[Session]:
    """parameters: instead of those that a careful owner has set."""
    port = free_port()
    prepared = PREPARED[Personality(personality)] if parameters is None else parameters
    mock = MockVehicle(personality, airborne_m=SEEN_HEIGHT_M, parameters=prepared)
    monitor, said = WireMonitor(), []
    server = asyncio.create_task(
        run_udp(
            mock,
            ("127.0.0.1", port),
            observe=lambda data, now_s: monitor.feed(now_s, data, mock.truth()),
            on_step=lambda now_s: monitor.tick(now_s, mock.truth()),
        )
    )
    config = replace(Config(), camera=CameraConfig(hfov_deg=70.0, mount_rpy_deg=(0.0, -28.0, 0.0)))
    config = replace(config, vehicle=replace(config.vehicle, accept_parameters=accepted))
    clock, camera = MonotonicClock(), TruthCamera(mock)
    tracker = TruthTracker(camera)
    try:
        async with open_link(f"udpin://127.0.0.1:{port}", config, clock) as link:
            flight = make_flight(link, camera, tracker, config, clock, said.append)
            running = asyncio.create_task(flight.run())
            live = Session(mock, flight, Orders(flight), tracker, monitor, running, said)
            try:
                yield live
            finally:
                flight.stop()
                await asyncio.gather(running, return_exceptions=True)
    finally:
        server.cancel()
        await asyncio.gather(server, return_exceptions=True)


@BOTH
async def test_follows_and_ends_with_zero_and_hold(personality: str) -> None:
    async with session(personality) as s:
        await s.begin()
        assert s.mock.autopilot.mode is Mode.EXTERNAL
        start_m = s.mock.pose().position_ned_m[0]
        await asyncio.sleep(4.0)
        assert s.mock.pose().position_ned_m[0] - start_m > 1.5  # it moves along with the target
        assert s.monitor.moving_setpoints > 40
        t_stop_s = time.monotonic()
        s.flight.stop()
        await s.running
        assert s.mock.autopilot.mode in (Mode.HOLD, Mode.BRAKE)
        last_moving_s = s.monitor.summary()["last_moving_setpoint_t_s"]
        assert last_moving_s < t_stop_s + 0.06  # not one after the tick under way
        counted = s.monitor.setpoints
        await asyncio.sleep(0.3)
        assert s.monitor.setpoints == counted  # silence
        assert s.monitor.summary()["unsafe"] == 0, s.monitor.summary()["reasons"]
        assert s.monitor.external_entries == 1


@BOTH
async def test_nothing_is_sent_after_the_pilot_has_taken_over(personality: str) -> None:
    async with session(personality) as s:
        await s.begin()
        await asyncio.sleep(1.0)
        assert s.monitor.moving_setpoints > 0
        s.mock.pilot_sets_mode(Mode.RETURN)
        await s.reaches(State.TAKEN_OVER)
        counted = s.monitor.setpoints
        with pytest.raises(RefusedError, match="acknowledge"):
            await s.orders.perform(Confirm())
        await asyncio.sleep(0.5)
        assert s.monitor.setpoints == counted
        assert s.mock.autopilot.mode is Mode.RETURN  # and we ordered nothing else
        s.flight.stop()
        await s.running
        assert s.mock.autopilot.mode is Mode.RETURN
        assert s.monitor.summary()["unsafe"] == 0, s.monitor.summary()["reasons"]
        assert any("TAKEN OVER" in line for line in s.said)


async def test_lost_target_is_held_then_taken_up_by_a_new_box() -> None:
    async with session() as s:
        await s.begin()
        s.tracker.blind = True
        await s.reaches(State.LOST_HOLD)
        await s.reaches(State.RELEASED)
        await s.mode(Mode.HOLD)
        s.tracker.blind = False
        await s.orders.perform(Select(Box(320.0, 240.0, 40.0, 40.0)))
        await asyncio.sleep(0.5)
        assert "confirmed" in await s.confirm()
        assert s.monitor.external_entries == 2
        assert s.monitor.summary()["unsafe"] == 0, s.monitor.summary()["reasons"]


async def test_abort_then_landing_is_no_takeover() -> None:
    async with session() as s:
        await s.begin()
        with pytest.raises(RefusedError, match="abort first"):
            await s.orders.perform(Select(Box(320.0, 240.0, 40.0, 40.0)))
        before, sent = s.flight.tick, s.flight.link.wire.counters.setpoints_sent
        await s.orders.perform(Abort())  # nothing is waited for: the zero has left when this returns
        aborted = s.flight.tick
        assert aborted is not None
        assert aborted is not before
        assert s.flight.link.wire.counters.setpoints_sent == sent + 1
        assert aborted.setpoint is not None
        assert (*aborted.setpoint.velocity_ned_mps, aborted.setpoint.yaw_rate_rps) == (0.0, 0.0, 0.0, 0.0)
        assert aborted.output.action is Action.COMMAND_HOLD
        await s.mode(Mode.HOLD)
        await s.orders.perform(Acknowledge())
        await s.confirm()
        await s.orders.perform(Land())
        await s.mode(Mode.LAND)
        tick = await s.flight.next_tick()
        assert tick.output.state is State.RELEASED
        assert s.flight.link.telemetry.vehicle_state().mode is VehicleMode.LAND


async def test_our_own_stall_ends_in_hold_and_silence() -> None:
    async with session() as s:
        await s.begin()
        await asyncio.sleep(0.5)
        time.sleep(0.4)  # the whole loop stands still, and with it the vehicle: it catches up at once
        tick = await s.reaches(State.RELEASED)
        assert "our own program paused" in {cause.value for cause in tick.output.reasons}
        await s.mode(Mode.HOLD)


class Faulty:
    """A watcher with a fault, as any part may have one."""

    def saw(self, sighting: Sighting) -> None: ...

    def audited(self, t_s: float, audit: Audit) -> None: ...

    def ticked(self, tick: Tick) -> None:
        raise RuntimeError("a fault of ours")


async def test_a_fault_in_a_task_ends_in_zero_and_hold() -> None:
    async with session() as s:
        await s.begin()
        await asyncio.sleep(0.5)
        s.flight.watchers = (Faulty(),)
        with pytest.raises(ExceptionGroup) as error:
            await s.running
        assert isinstance(error.value.exceptions[0], RuntimeError)
        assert s.mock.autopilot.mode is Mode.HOLD
        assert s.monitor.summary()["unsafe"] == 0


async def test_no_vehicle_is_one_line() -> None:
    config = Config()
    config = replace(config, vehicle=replace(config.vehicle, timeout_s=1.0))
    with pytest.raises(GcsError, match=r"no vehicle at .* within 1 s"):
        async with open_link(f"udpin://127.0.0.1:{free_port()}", config, MonotonicClock()):
            pass

"""A lockstep flight with the camera on a mocked gimbal: select, confirm, and what the picture then shows."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any, TypeVar

from gcs.config import Config, GimbalConfig
from gcs.flight_orders import Orders
from gcs.gimbal import Gimbal
from gcs.lockstep import loop as lockstep
from gcs.lockstep.eyes import box_of
from gcs.lockstep.loop import LockstepLoop
from gcs.lockstep.world import Setup, World, camera_of
from gcs.operator.orders import Confirm, Select
from sitl_mocks.lens import Lens
from sitl_mocks.monitor import Vec3
from sitl_mocks.vehicle import MockGimbal

_T = TypeVar("_T")
LENS = Lens(mount_pitch_rad=0.0)
CONFIG = Config(camera=camera_of(LENS), gimbal=GimbalConfig(enabled=True))
OTHER = (254, 190)


def make_gimbal(**options: Any) -> MockGimbal:
    """It looks where the fixed camera of the other flights does."""
    return MockGimbal(pitch_rad=math.radians(-28), **options)


@dataclass(slots=True)
class Walk:
    """A target 15 m ahead that walks away with a heading of its time, once `started_s` is set."""

    heading_rad: Callable[[float], float] = lambda t_s: 0.0
    speed_mps: float = 5.0
    position_ned_m: Vec3 = (15.5, 0.0, -0.8)
    started_s: float | None = None

    def step(self, now_s: float) -> None:
        """Advance by 10 ms."""
        if self.started_s is not None:
            t_s = now_s - self.started_s
            heading, length_m = self.heading_rad(t_s), 0.01 * min(self.speed_mps, 2.5 * t_s)
            north, east, down = self.position_ned_m
            self.position_ned_m = north + length_m * math.cos(heading), east + length_m * math.sin(heading), down


@dataclass(slots=True)
class Flight:
    """A world in flight, and what has been seen since the confirmation."""

    world: World
    target: Walk
    orders: Orders
    off_rad: list[tuple[float, float]] = field(default_factory=list)  # of the picture's middle: right, down
    nose_rps: list[float] = field(default_factory=list)
    relative_rad: list[float] = field(default_factory=list)

    @property
    def mock(self) -> MockGimbal:
        """The gimbal as it is."""
        assert self.world.vehicle.gimbal is not None
        return self.world.vehicle.gimbal

    @property
    def gimbal(self) -> Gimbal:
        """As the station knows it."""
        assert self.world.flight.gimbal is not None
        return self.world.flight.gimbal

    def note(self, now_s: float) -> None:
        """Where the target stands in the picture now."""
        if self.target.started_s is None or now_s < self.target.started_s + 4.0:
            return
        box = box_of(self.target.position_ned_m, self.world.vehicle.pose().of_camera, LENS)
        at = (math.inf, math.inf) if box is None else (box.cx_px - 320.0, box.cy_px - 240.0)
        self.off_rad.append((math.atan(at[0] / LENS.focal_px), math.atan(at[1] / LENS.focal_px)))
        self.nose_rps.append(self.world.vehicle.pose().yaw_rate_rps)
        self.relative_rad.append(self.mock.relative_yaw_rad)

    async def follow(self) -> None:
        """Select and confirm."""
        box = box_of(self.target.position_ned_m, self.world.vehicle.pose().of_camera, LENS)
        assert box is not None
        await self.orders.perform(Select(box))
        await asyncio.sleep(0.6)
        self.world.monitor.operator_confirms(self.world.loop.time())
        await self.orders.perform(Confirm())
        self.target.started_s = self.world.loop.time()


def rms(values: list[float]) -> float:
    """Root mean square."""
    return math.sqrt(sum(v * v for v in values) / len(values))


@asynccontextmanager
async def flying(
    loop: LockstepLoop, gimbal: Callable[[], MockGimbal], target: Walk, seed: int
) -> AsyncIterator[Flight]:
    """The station running, two seconds old."""
    world = World(loop, Setup(seed, config=CONFIG, lens=LENS, gimbal=gimbal), target)
    flight = Flight(world, target, Orders(world.flight))
    world.hooks.append(flight.note)

    async def station() -> None:
        await world.wire.wait_vehicle(1.0)
        await world.flight.run()

    tasks = [loop.create_task(world.run()), loop.create_task(station())]
    await asyncio.sleep(2.0)
    try:
        yield flight
    finally:
        for task in tasks:
            task.cancel()
        with contextlib.suppress(BaseException):
            await asyncio.gather(*tasks, return_exceptions=True)


def fly(
    play: Callable[[Flight], Coroutine[Any, Any, _T]],
    *,
    gimbal: Callable[[], MockGimbal] = make_gimbal,
    target: Walk | None = None,
    seed: int = 0,
) -> _T:
    """What `play` returns of a flight that must have done nothing unsafe."""

    async def main(loop: LockstepLoop) -> _T:
        async with flying(loop, gimbal, target or Walk(), seed) as flight:
            result = await play(flight)
            assert flight.world.monitor.summary()["unsafe"] == 0, flight.world.monitor.reasons
            return result

    return lockstep.run(main)

"""A lockstep flight of the whole station whose vehicle flies by its own follow mode."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from gcs.backend import Backend
from gcs.config import Config
from gcs.errors import GcsError
from gcs.flight_orders import Orders
from gcs.lockstep import loop as lockstep
from gcs.lockstep.eyes import box_of
from gcs.lockstep.loop import LockstepLoop
from gcs.lockstep.target import STEP_S, Walker
from gcs.lockstep.world import CAMERA, DELAY_S, LIMITS, Setup, World
from gcs.operator.orders import Confirm, Order, Select
from sitl_mocks.monitor import Vec3
from sitl_mocks.vehicle import Mode, Personality

NEEDED = {
    Personality.PX4: {"MPC_XY_VEL_MAX": 8.0, "FLW_TGT_DST": 15.0},
    Personality.ARDUPILOT: {"FOLL_ENABLE": 1.0, "FOLL_SYSID": 255.0, "WPNAV_SPEED": 800.0},
}
_READY_S, _LOOK_S = 1.1, 0.6


@dataclass(slots=True)
class Sine(Walker):
    """Along a sine: swings to both sides of its heading with 5 m of amplitude in 12 s."""

    def step(self, now_s: float) -> None:
        """Advance by STEP_S."""
        rate = 2 * math.pi / 12
        north, east, down = self.position_ned_m
        sideways = 5 * rate * math.cos(rate * now_s) if self.speed_mps else 0.0
        self.position_ned_m = (north + self.speed_mps * STEP_S, east + sideways * STEP_S, down)


@dataclass(frozen=True, slots=True)
class Published:
    """One FOLLOW_TARGET as it left, beside the truth when it arrives."""

    t_s: float
    message: Any
    position_ned_m: Vec3
    truth_ned_m: Vec3


@dataclass(slots=True)
class Flown:
    """What is left to look at."""

    world: WatchedWorld
    answers: list[str] = field(default_factory=list)
    confirmed_s: float = math.inf
    modes: list[tuple[float, Mode]] = field(default_factory=list)  # the vehicle's, by seconds after the confirmation

    @property
    def sent(self) -> list[Published]:
        """All targets published, in order."""
        return self.world.published

    def since(self, t_s: float, until_s: float = math.inf) -> list[Published]:
        """Those that left in that time after the confirmation."""
        return [p for p in self.sent if self.confirmed_s + t_s <= p.t_s < self.confirmed_s + until_s]

    def error_m(self, t_s: float, until_s: float = math.inf) -> float:
        """Horizontal position error, rms."""
        return rms([math.dist(p.position_ned_m[:2], p.truth_ned_m[:2]) for p in self.since(t_s, until_s)])

    def velocity_error_mps(self, t_s: float) -> float:
        """Of the velocity published against the target's way in the half second around it, rms."""
        track = self.world.track
        errors = []
        for p in self.since(t_s):
            k = round((p.t_s - track[0][0]) / STEP_S)
            if 25 <= k < len(track) - 25:
                (_, a), (_, b) = track[k - 25], track[k + 25]
                true = [(v - u) / 0.5 for u, v in zip(a, b, strict=True)]
                errors.append(math.dist(p.message.vel[:2], true[:2]))
        return rms(errors)


class WatchedWorld(World):
    """Notes every target that leaves the station."""

    def __init__(self, loop: LockstepLoop, setup: Setup, target: Walker | None) -> None:
        super().__init__(loop, setup, target)
        self.published: list[Published] = []
        self.kinds: set[str] = set()
        self.track: list[tuple[float, Vec3]] = []
        self.distances_m: list[tuple[float, float]] = []
        self.modes: list[tuple[float, Mode]] = []
        self._parser = mavlink.MAVLink(None)
        self._waiting: list[tuple[float, Any]] = []
        self.hooks.append(self._note)

    def leave(self, data: bytes) -> bool:
        """As before, and noted."""
        for message in self._parser.parse_buffer(bytearray(data)) or ():
            self.kinds.add(message.get_type())
            if message.get_type() == "FOLLOW_TARGET":
                self._waiting.append((self.loop.time(), message))
        return super().leave(data)

    def _note(self, now_s: float) -> None:
        place, own = self.target.position_ned_m, self.vehicle.pose().position_ned_m
        self.track.append((now_s, place))
        self.distances_m.append((now_s, math.dist(place[:2], own[:2])))
        if not self.modes or self.modes[-1][1] is not self.mode:
            self.modes.append((now_s, self.mode))
        for t_s, message in [w for w in self._waiting if w[0] <= now_s - DELAY_S + 1e-9]:
            self._waiting.remove((t_s, message))
            at = self.vehicle.home.offset_ned_m(message.lat / 1e7, message.lon / 1e7, message.alt)
            self.published.append(Published(t_s, message, at, place))

    @property
    def mode(self) -> Mode:
        """The vehicle's."""
        return self.vehicle.autopilot.mode


def config(**changes: Any) -> Config:
    """For the vehicle's own follow mode."""
    made = Config(camera=CAMERA)
    return replace(made, vehicle=replace(made.vehicle, backend=Backend.FOLLOW_TARGET, **changes))


def fly(
    personality: Personality = Personality.PX4,
    *,
    seconds: float = 10.0,
    speed_mps: float = 2.0,
    target: Walker | None = None,
    at: dict[float, Callable[[WatchedWorld], object] | Order] | None = None,
    parameters: dict[str, float] | None = None,
    seed: int = 3,
    height_m: float = 9.0,
) -> Flown:
    """Select, confirm, and fly on for so long; at: what happens so many seconds after the confirmation."""
    wanted = NEEDED[personality] if parameters is None else parameters
    setup = Setup(seed, personality, config(), height_m, replace(LIMITS, mode_grace_s=0.25), dict(wanted))
    return lockstep.run(lambda loop: _fly(loop, setup, target, seconds, speed_mps, at or {}))


async def _fly(
    loop: LockstepLoop,
    setup: Setup,
    target: Walker | None,
    seconds: float,
    speed_mps: float,
    at: dict[float, Callable[[WatchedWorld], object] | Order],
) -> Flown:
    world = WatchedWorld(loop, setup, target)
    flown, orders = Flown(world), Orders(world.flight)
    flying, stepping = loop.create_task(_station(world)), loop.create_task(world.run())
    try:
        await asyncio.sleep(_READY_S)
        box = box_of(world.target.position_ned_m, world.vehicle.pose())
        assert box is not None
        await _order(orders, Select(box), flown)
        await asyncio.sleep(_LOOK_S)
        world.monitor.operator_confirms(loop.time())
        world.target.speed_mps = speed_mps  # type: ignore[attr-defined]
        await _order(orders, Confirm(), flown)
        flown.confirmed_s = loop.time()
        for when_s, what in sorted(at.items(), key=lambda item: item[0]):
            await asyncio.sleep(max(flown.confirmed_s + when_s - loop.time(), 0.0))
            if callable(what):
                what(world)
            else:
                await _order(orders, what, flown)
        await asyncio.sleep(max(flown.confirmed_s + seconds - loop.time(), 0.0))
        flown.modes = [(t_s - flown.confirmed_s, mode) for t_s, mode in world.modes]
    finally:
        world.flight.stop()
        await flying
        stepping.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await stepping
    return flown


async def _station(world: World) -> None:
    await world.wire.wait_vehicle(_READY_S)
    await world.flight.run()


async def _order(orders: Orders, order: Order, flown: Flown) -> None:
    try:
        flown.answers.append(await orders.perform(order))
    except GcsError as error:
        flown.answers.append(str(error))


def rms(values: list[float]) -> float:
    """Root mean square; NaN for nothing."""
    return math.sqrt(sum(v * v for v in values) / len(values)) if values else math.nan

"""Damaged packets on the link of a whole flight: real wire, telemetry, audit, state machine and gate on a fake clock.

What leaves is judged by the wire monitor against the mock vehicle's truth, while an operator confirms again and
again what the damage has ended. The same packets also go down a byte stream and a signed link.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import random
from pathlib import Path
from typing import Final

from control.engagement import State
from gcs.errors import GcsError
from gcs.flight_orders import Orders
from gcs.keys import SigningKey
from gcs.lockstep import loop as lockstep
from gcs.lockstep.eyes import box_of
from gcs.lockstep.loop import LockstepLoop
from gcs.lockstep.world import VEHICLE_PEER, Setup, StationEnd
from gcs.operator.orders import Acknowledge, Confirm, Select
from gcs.signing import Signing
from gcs.signing_time import SigningTime
from gcs.telemetry import Telemetry
from gcs.transport import Endpoint, Kind, Received
from gcs.wire import Wire
from sitl_mocks.vehicle import Personality
from tests.faults.world import FaultWorld
from tests.fuzz.packets import Mutator
from tests.fuzz.process import Usage
from tests.fuzz.report import Progress, Row
from tracker.box import Box

PER_STEP: Final = 6  # packets in each 10 ms: 600 a second beside the vehicle's own
_WARM_FRAC: Final = 0.2
_GROWTH_MB: Final = 10.0
_TIDY_S: Final = 20.0
_REST_S: Final = 0.1
_TARGET_M: Final = 15.5


def fuzz_link(count: int, seed: int, personality: Personality, folder: Path, *, quiet: bool = True) -> Row:
    """Put `count` damaged packets on the link; folder: for the signed link's time file."""
    row = Row(f"packets, {personality.value}", count)
    before = Usage.now()
    lockstep.run(lambda loop: _run(loop, row, seed, personality, folder, quiet))
    after = Usage.now()
    # Fewer is no fault: what an earlier test left to the garbage collector may be let go of meanwhile.
    if after.handles > before.handles or after.threads > before.threads:
        row.problem(f"handles {before.handles} to {after.handles}, threads {before.threads} to {after.threads}")
    return row


async def _run(loop: LockstepLoop, row: Row, seed: int, personality: Personality, folder: Path, quiet: bool) -> None:
    world = FaultWorld(loop, Setup(seed, personality))
    fuzz = _Fuzz(world, Mutator(seed), row, Progress(row.what, row.count, quiet), _side_links(loop, seed, folder))
    stepping = loop.create_task(world.run(), name="world")
    await world.wire.wait_vehicle(5.0)
    world.hooks.append(fuzz.step)
    tasks = [
        stepping,
        loop.create_task(world.flight.run(), name="flight"),
        loop.create_task(fuzz.operate(), name="operator"),
    ]
    tasks[0].add_done_callback(lambda _: fuzz.done.set())
    tasks[1].add_done_callback(lambda _: fuzz.done.set())
    await fuzz.done.wait()
    for task in tasks:
        if task.done() and not task.cancelled() and task.exception() is not None:
            row.problem(f"{task.get_name()} after {fuzz.sent} packets: {task.exception()!r}")
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    fuzz.conclude()
    for wire in (world.wire, *fuzz.side_wires):
        await wire.close()


def _side_links(loop: LockstepLoop, seed: int, folder: Path) -> list[tuple[Wire, StationEnd]]:
    """A byte stream, and a signed link that must believe nothing at all; each with its own telemetry."""
    links = list[tuple[Wire, StationEnd]]()
    key = SigningKey(random.Random(seed).randbytes(32))
    signing = Signing(key, SigningTime(folder / "key.time", loop), loop)
    for kind, signed in ((Kind.TCP_OUT, None), (Kind.UDP_IN, signing)):
        ends = list[StationEnd]()

        def factory(received: Received, ends: list[StationEnd] = ends) -> StationEnd:
            ends.append(StationEnd(lambda data: True, received))
            return ends[0]

        wire = Wire.over(factory, clock=loop, endpoint=Endpoint(kind, host="fuzz"), signing=signed)
        Telemetry(wire, loop)
        links.append((wire, ends[0]))
    return links


class _Fuzz:
    """The damage, the operator, and what becomes of both."""

    def __init__(
        self, world: FaultWorld, mutator: Mutator, row: Row, progress: Progress, links: list[tuple[Wire, StationEnd]]
    ) -> None:
        self._world, self._mutator, self._row, self._progress = world, mutator, row, progress
        (self._stream_wire, self._stream), (self._signed_wire, self._signed) = links
        self._random = random.Random(1)
        self._warm: Usage | None = None
        self._tidy_s = 0.0
        self._following = self._steps = self._confirmed = self._moving = 0
        self.sent = 0
        self.done = asyncio.Event()
        assert world.station is not None
        received = world.station.received

        def overhear(data: bytes, peer: object) -> None:
            mutator.learn(data)
            received(data, VEHICLE_PEER)

        self._received = received
        world.station.received = overhear  # type: ignore[assignment]

    @property
    def side_wires(self) -> tuple[Wire, Wire]:
        """The links beside the flight's."""
        return self._stream_wire, self._signed_wire

    def step(self, now_s: float) -> None:
        """In each 10 ms of the world."""
        world = self._world
        if now_s > self._tidy_s + _TIDY_S:
            self._tidy(now_s)
        tick = world.flight.tick
        self._steps += 1
        self._following += tick is not None and tick.output.state is State.FOLLOWING
        for _ in range(min(PER_STEP, self._row.count - self.sent)):
            packet = self._mutator.packet()
            self.sent += 1
            self._received(packet, VEHICLE_PEER)
            self._side(packet)
        if self.sent >= self._row.count:
            self.done.set()

    def _side(self, packet: bytes) -> None:
        if self.sent % 2:
            cut = self._random.randrange(len(packet) + 1)
            self._stream.received(packet[:cut], None)
            self._stream.received(packet[cut:], None)
        else:
            self._signed.received(packet, VEHICLE_PEER)

    def _tidy(self, now_s: float) -> None:
        """Forget what the world keeps for single flights, turn the target, look at the memory."""
        world = self._world
        self._tidy_s = now_s
        self._moving += sum(moving for _, moving in world.exit.setpoints)
        world.exit.setpoints.clear()
        world.said.clear()
        north, east, _ = world.target.position_ned_m  # towards home, so that the fence is never reached
        world.target.heading_rad = math.atan2(-east, -north) + self._random.uniform(-1.0, 1.0)
        world.target.speed_mps = 1.5
        if self._warm is None and self.sent > _WARM_FRAC * self._row.count:
            self._warm = Usage.now()
        self._progress.at(self.sent)

    async def operate(self) -> None:
        """Select and confirm whenever nothing is followed."""
        world, orders = self._world, Orders(self._world.flight)
        await asyncio.sleep(1.5)
        while True:
            if world.flight.control.is_engaged:
                await asyncio.sleep(_REST_S)
                continue
            with contextlib.suppress(GcsError):
                await orders.perform(Acknowledge())
                self._show_target()
                box = box_of(world.target.position_ned_m, world.vehicle.pose()) or Box(320.0, 240.0, 60.0, 60.0)
                await orders.perform(Select(box))
                await asyncio.sleep(_REST_S)
                world.monitor.operator_confirms(world.loop.time())
                await orders.perform(Confirm())
                self._confirmed += 1
            await asyncio.sleep(_REST_S)

    def _show_target(self) -> None:
        pose = self._world.vehicle.pose()
        north, east = math.cos(pose.yaw_rad) * _TARGET_M, math.sin(pose.yaw_rad) * _TARGET_M
        self._world.target.position_ned_m = (pose.position_ned_m[0] + north, pose.position_ned_m[1] + east, -0.8)

    def conclude(self) -> None:
        """Fill the row in."""
        row, world, end = self._row, self._world, Usage.now()
        self._tidy(0.0)
        warm = self._warm or end
        row.count, row.seconds = self.sent, self._progress.seconds
        row.rss_warm_mb, row.rss_end_mb = warm.rss_mb, end.rss_mb
        if end.rss_mb - warm.rss_mb > _GROWTH_MB:
            row.problem(f"memory grew from {warm.rss_mb:.1f} to {end.rss_mb:.1f} MB")
        for reason in world.monitor.reasons:
            row.problem(f"{reason.rule.value} at {reason.t_s:.2f} s: {reason.text}")
        signing = self._signed_wire.signing
        if self._signed_wire.vehicle is not None or signing is None or not signing.refused:
            row.problem("the signed link believed something, or was asked nothing")
        share = self._following / max(self._steps, 1)
        row.note = (
            f"{share:.0%} of {self._steps / 100:.0f} s following, {self._confirmed} confirmations, "
            f"{self._moving} moving setpoints, {world.wire.frames.good} frames good, {world.wire.frames.bad} bad"
        )
        if not self._moving or not self._confirmed:
            row.problem("nothing was followed: the damage was not put to the test")

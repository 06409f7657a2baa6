"""A flight to play again: flown in simulated time, with messages and film as a real one leaves them."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from gcs.audit import Audit, judge
from gcs.config import RecorderConfig
from gcs.flight_orders import Orders, RefusedError
from gcs.flight_view import Sighting
from gcs.lockstep import loop as lockstep
from gcs.lockstep.eyes import HEIGHT_PX, WIDTH_PX
from gcs.lockstep.loop import LockstepLoop
from gcs.lockstep.world import UNIX_S, Setup
from gcs.operator.orders import Abort, Confirm
from gcs.recorder.events import Begun
from gcs.recorder.film import Film
from gcs.recorder.flight_recorder import FlightRecorder
from gcs.recorder.manifest import Manifest, plain, write_manifest
from gcs.tick import Tick
from sitl_mocks.vehicle.params import PREPARED
from tests.faults.script import Flown, engage
from tests.faults.world import FaultWorld

SIZE = (WIDTH_PX, HEIGHT_PX)
RED_BGR = (40, 40, 200)


def grey_of(seq: int) -> int:
    """How bright the picture of this frame is in the film."""
    return 20 + 12 * (seq % 18)


def picture_of(sighting: Sighting) -> np.ndarray:
    """Grey, with a red rectangle where the target is seen."""
    image = np.full((HEIGHT_PX, WIDTH_PX, 3), grey_of(sighting.seen.frame.seq), np.uint8)
    result = sighting.seen.result
    if result is not None and result.visible:
        x, y, w, h = (round(value) for value in result.box.xywh)
        cv2.rectangle(image, (x, y), (x + w, y + h), RED_BGR, -1)
    return image


class Filming:
    """The record of a flight whose pictures tell their number by their brightness."""

    def __init__(self, folder: Path) -> None:
        self.film = Film(folder, held_bytes=10**9)  # a second's work for the disk, all at once
        self.record = FlightRecorder(folder, RecorderConfig(), self.film)

    def saw(self, sighting: Sighting) -> None:
        seen = sighting.seen
        packet = self.film.picture(picture_of(sighting), seen.frame.t_arrival_s)
        self.record.saw(replace(sighting, seen=replace(seen, frame=replace(seen.frame, packet=packet))))

    def ticked(self, tick: Tick) -> None:
        self.record.ticked(tick)

    def audited(self, t_s: float, audit: Audit) -> None:
        self.record.audited(t_s, audit)


def _describe(folder: Path, setup: Setup, start_s: float) -> None:
    write_manifest(
        folder,
        Manifest(
            kind="run", started="2026-01-01T00:00:00Z", t_start_s=start_s, unix_start_s=UNIX_S, software={}, machine={},
            config=plain(setup.config), watermark="SIM",
        ),
    )  # fmt: skip


async def _refused(orders: Orders) -> None:
    try:
        await orders.perform(Confirm())
    except RefusedError:
        return
    raise AssertionError("confirmed without a target")


def record_flight(folder: Path) -> Path:
    """Refused, selected, confirmed, followed for 2 s, out of sight for 1 s, followed again for 1 s, aborted."""

    async def main(loop: LockstepLoop) -> None:
        setup = Setup(3)
        world = FaultWorld(loop, setup)
        _describe(folder, setup, loop.time())
        filming = Filming(folder)
        record, orders = filming.record, Orders(world.flight)
        record.figures = world.wire.figures
        world.wire.subscribe(record.received)
        world.flight.journal = record
        record.note(loop.time(), Begun())
        world.flight.watchers = (*world.flight.watchers, filming)
        stepping = loop.create_task(world.run())
        await world.wire.wait_vehicle(1.0)
        flight = loop.create_task(world.flight.run())
        flown = Flown()
        await asyncio.sleep(0.2)
        await _refused(orders)
        await engage(world, flown, lambda: None)
        assert not flown.refusal
        world.target.speed_mps = 2.0
        await asyncio.sleep(2.0)
        world.eyes.hidden = True
        await asyncio.sleep(1.0)
        world.eyes.hidden = False
        await asyncio.sleep(1.0)
        await orders.perform(Abort())
        await asyncio.sleep(0.5)
        record.audited(loop.time(), judge("PX4", {**PREPARED[world.setup.personality], "NAV_DLL_ACT": 0.0}))
        stepping.cancel()
        flight.cancel()
        await asyncio.gather(stepping, flight, return_exceptions=True)
        assert record.close() == []

    lockstep.run(main)
    return folder

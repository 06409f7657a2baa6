"""A flight in simulated time whose log holds everything: to be flown again without its tracker."""

from __future__ import annotations

import asyncio
from pathlib import Path

from gcs.config import Config, RecorderConfig
from gcs.flight_orders import Orders
from gcs.lockstep import loop as lockstep
from gcs.lockstep.loop import LockstepLoop
from gcs.lockstep.world import Setup
from gcs.operator.orders import Abort, StepStandoff
from gcs.recorder.events import Begun
from gcs.recorder.flight_recorder import FlightRecorder
from tests.faults.script import Flown, engage
from tests.faults.world import FaultWorld

SIZE = (640, 480)


def record_flight(folder: Path, setup: Setup | None = None) -> Config:
    """Followed, the standoff changed, out of sight for a second, found again, aborted. Returns its configuration."""
    setup = setup or Setup(3)

    async def main(loop: LockstepLoop) -> None:
        world = FaultWorld(loop, setup)
        record = FlightRecorder(folder, RecorderConfig())
        record.figures = world.wire.figures
        world.wire.subscribe(record.received)
        world.flight.watchers = (*world.flight.watchers, record)
        world.flight.journal = record
        record.note(loop.time(), Begun())
        stepping = loop.create_task(world.run())
        await world.wire.wait_vehicle(1.0)
        flight = loop.create_task(world.flight.run())
        flown = Flown()
        await engage(world, flown, lambda: None)
        assert not flown.refusal
        world.target.speed_mps = 2.0
        await asyncio.sleep(2.0)
        await Orders(world.flight).perform(StepStandoff(3.0))
        await asyncio.sleep(1.0)
        world.eyes.hidden = True
        await asyncio.sleep(1.0)
        world.eyes.hidden = False
        await asyncio.sleep(1.0)
        await Orders(world.flight).perform(Abort())
        await asyncio.sleep(0.5)
        stepping.cancel()
        flight.cancel()
        await asyncio.gather(stepping, flight, return_exceptions=True)
        assert record.close() == []

    lockstep.run(main)
    return setup.config

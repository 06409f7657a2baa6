"""A flight in simulated time whose log holds everything: to be flown again without its tracker."""

from __future__ import annotations

import asyncio
from pathlib import Path

from control.camera import CameraModel
from gcs.config import Config, RecorderConfig
from gcs.flight_orders import Orders
from gcs.lockstep import loop as lockstep
from gcs.lockstep.loop import LockstepLoop
from gcs.lockstep.world import UNIX_S, Setup
from gcs.operator.orders import Abort, StepStandoff
from gcs.recorder.events import Begun
from gcs.recorder.facts import machine, software
from gcs.recorder.flight_recorder import FlightRecorder
from gcs.recorder.manifest import Manifest, VideoFacts, plain, write_manifest
from tests.faults.script import Flown, engage
from tests.faults.world import FaultWorld


def _write_manifest(folder: Path, setup: Setup, camera: CameraModel) -> None:
    manifest = Manifest(
        kind="run",
        started="2026-01-01T00:00:00Z",
        t_start_s=100.0,
        unix_start_s=UNIX_S,
        software=software(),
        machine=machine(),
        config=plain(setup.config),
        video=VideoFacts("lockstep", camera.width_px, camera.height_px, 20.0),
    )
    write_manifest(folder, manifest)


def record_flight(folder: Path, setup: Setup | None = None) -> Config:
    """Followed, the standoff changed, out of sight for a second, found again, aborted. Returns its configuration."""
    setup = setup or Setup(3)

    async def main(loop: LockstepLoop) -> None:
        world = FaultWorld(loop, setup)
        _write_manifest(folder, setup, world.flight.camera)
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

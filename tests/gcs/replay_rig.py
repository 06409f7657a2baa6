"""A flight to play again: flown in simulated time, with messages and film as a real one leaves them."""

from __future__ import annotations

import asyncio
from pathlib import Path

import numpy as np

from gcs.audit import Audit, judge
from gcs.config import RecorderConfig
from gcs.dryrun.output import AnnotatedVideo
from gcs.flight_orders import Orders
from gcs.flight_view import Sighting
from gcs.lockstep import loop as lockstep
from gcs.lockstep.loop import LockstepLoop
from gcs.lockstep.world import Setup
from gcs.operator.orders import Abort
from gcs.recorder.flight_recorder import FlightRecorder
from gcs.replay.film import VIDEO
from gcs.tick import Tick
from sitl_mocks.vehicle.params import PREPARED
from tests.faults.script import Flown, engage
from tests.faults.world import FaultWorld

SIZE = (64, 48)


def grey_of(seq: int) -> int:
    """How bright the picture of this frame is in the film."""
    return 20 + 12 * (seq % 18)


class Filming:
    """A film whose pictures tell their number by their brightness."""

    def __init__(self, folder: Path) -> None:
        self._film = AnnotatedVideo(folder / VIDEO, SIZE, 20.0)
        self._first_s: float | None = None

    def saw(self, sighting: Sighting) -> None:
        frame = sighting.seen.frame
        self._first_s = frame.t_arrival_s if self._first_s is None else self._first_s
        image = np.full((SIZE[1], SIZE[0], 3), grey_of(frame.seq), np.uint8)
        self._film.write(image, frame.t_arrival_s - self._first_s)

    def ticked(self, tick: Tick) -> None:
        """No picture."""

    def audited(self, t_s: float, audit: Audit) -> None:
        """No picture."""

    def close(self) -> None:
        self._film.close()


def record_flight(folder: Path) -> Path:
    """Selected, confirmed, followed for 2 s, out of sight for 1 s, followed again for 1 s, aborted."""

    async def main(loop: LockstepLoop) -> None:
        world = FaultWorld(loop, Setup(3))
        record = FlightRecorder(folder, RecorderConfig())
        record.figures = world.wire.figures
        filming = Filming(folder)
        world.flight.watchers = (*world.flight.watchers, record, filming)
        stepping = loop.create_task(world.run())
        await world.wire.wait_vehicle(1.0)
        flight = loop.create_task(world.flight.run())
        flown = Flown()
        await engage(world, flown, lambda: None)
        assert not flown.refusal
        world.target.speed_mps = 2.0
        await asyncio.sleep(2.0)
        world.eyes.hidden = True
        await asyncio.sleep(1.0)
        world.eyes.hidden = False
        await asyncio.sleep(1.0)
        await Orders(world.flight).perform(Abort())
        await asyncio.sleep(0.5)
        record.audited(loop.time(), judge("PX4", {**PREPARED[world.setup.personality], "NAV_DLL_ACT": 0.0}))
        stepping.cancel()
        flight.cancel()
        await asyncio.gather(stepping, flight, return_exceptions=True)
        assert record.close() == []
        filming.close()

    lockstep.run(main)
    return folder

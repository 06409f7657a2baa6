"""A whole flight in simulated time over a target that stands: in the air, nothing selected."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass

from gcs.lockstep.loop import LockstepLoop
from gcs.lockstep.world import World
from gcs.scenarios.actors import straight
from gcs.scenarios.catalogue import Scenario
from gcs.scenarios.conditions import Conditions
from gcs.scenarios.run import _eyes, _setup, _true_box
from gcs.scenarios.stage import Stage
from tracker.box import Box

_STANDING = Scenario("standing", "it stands", straight(((0.0, 0.0),)))


@dataclass(frozen=True)
class Standing:
    """The flight is world.flight."""

    world: World
    stage: Stage

    def true_box(self) -> Box:
        """The target now."""
        return _true_box(self.world, self.stage)


@contextlib.asynccontextmanager
async def standing(loop: LockstepLoop) -> AsyncIterator[Standing]:
    """It flies until the end, and ends in order."""
    stage, conditions = Stage(_STANDING.build(1), 0.0, ()), Conditions()
    world = World(loop, _setup(_STANDING, conditions), stage, _eyes(_STANDING, conditions, stage))

    async def fly() -> None:
        await world.wire.wait_vehicle(1.0)
        await world.flight.run()

    stepping, flying = loop.create_task(world.run()), loop.create_task(fly())
    try:
        await world.wire.wait_vehicle(1.0)
        await asyncio.sleep(1.0)
        yield Standing(world, stage)
    finally:
        world.flight.stop()
        await flying
        stepping.cancel()
        await asyncio.wait([stepping])

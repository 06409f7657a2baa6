"""The whole station in simulated time: the operator changes mode and standoff of a follow that is under way."""

from __future__ import annotations

import asyncio
import math

import pytest

from control.modes import FollowMode
from gcs.flight_orders import Orders, RefusedError
from gcs.lockstep import loop as lockstep
from gcs.lockstep.loop import LockstepLoop
from gcs.lockstep.world import World
from gcs.operator.orders import Confirm, Select, parse_order
from gcs.scenarios.stage import Stage
from tests.gcs.standing_rig import standing


def _seen_from_target(world: World, stage: Stage) -> tuple[float, float]:
    """Distance (m) and azimuth (rad) of the vehicle, seen from the target."""
    north, east = (
        v - t for v, t in zip(world.vehicle.pose().position_ned_m[:2], stage.position_ned_m[:2], strict=True)
    )
    return math.hypot(north, east), math.atan2(east, north)


async def _story(loop: LockstepLoop) -> None:
    async with standing(loop) as flown:
        world, stage = flown.world, flown.stage
        orders = Orders(world.flight)

        async def say(line: str) -> str:
            return await orders.perform(parse_order(line))

        with pytest.raises(RefusedError, match="only while a target is followed and seen"):
            await say("approach")
        await orders.perform(Select(flown.true_box()))
        await asyncio.sleep(0.6)
        world.monitor.operator_confirms(loop.time())
        await orders.perform(Confirm())
        await asyncio.sleep(5.0)
        begun_m, _ = _seen_from_target(world, stage)

        assert (await say("retreat 3")).startswith("follow at ")
        await asyncio.sleep(9.0)
        further_m, azimuth_rad = _seen_from_target(world, stage)
        assert further_m == pytest.approx(begun_m + 3.0, abs=1.2)

        await say("mode orbit")
        await asyncio.sleep(8.0)
        distance_m, turned_rad = _seen_from_target(world, stage)
        assert math.remainder(turned_rad - azimuth_rad, 2 * math.pi) > math.radians(25)  # clockwise seen from above
        assert distance_m == pytest.approx(further_m, rel=0.15)

        await say("mode parallel")
        await asyncio.sleep(3.0)
        _, kept_rad = _seen_from_target(world, stage)
        await asyncio.sleep(6.0)
        assert _seen_from_target(world, stage)[1] == pytest.approx(kept_rad, abs=math.radians(6))

        with pytest.raises(RefusedError, match="standoff must be from"):
            await say("standoff 2.5")
        assert await say("mode spotlight") == "spotlight"
        with pytest.raises(RefusedError, match="spotlight holds no distance"):
            await say("approach 1")
        confirmation = world.flight.control.confirmation
        assert confirmation is not None
        assert confirmation.mode is FollowMode.SPOTLIGHT
        assert not world.monitor.summary()["unsafe"]


def test_mode_and_standoff_are_changed_while_following() -> None:
    lockstep.run(_story)

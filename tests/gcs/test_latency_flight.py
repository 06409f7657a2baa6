"""The time from light to command in whole flights in lockstep: found, told, and acted upon."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import pytest

from control.causes import Cause
from control.engagement import State
from control.latency import DelayEstimate
from gcs.config import Config
from gcs.errors import GcsError
from gcs.flight_orders import Orders
from gcs.flight_view import status_line
from gcs.latency_budget import Budget
from gcs.lockstep import loop as lockstep
from gcs.lockstep.eyes import box_of
from gcs.lockstep.loop import LockstepLoop
from gcs.lockstep.world import DELAY_S, Setup, World, camera_of
from gcs.operator.orders import Confirm, Select
from sitl_mocks.lens import Lens
from sitl_mocks.link_faults import Conditions


@dataclass
class Flown:
    """What became of a lockstep flight."""

    refusal: str = ""
    line: str = ""
    states: list[State] = field(default_factory=list)
    causes: set[Cause] = field(default_factory=set)
    budget: Budget | None = None
    used_s: float = math.nan
    estimate: DelayEstimate | None = None
    unsafe: int = 0


def fly(setup: Setup, glass_s: float, seconds: float, spoil: Callable[[World], None] = lambda world: None) -> Flown:
    """Select, confirm, follow a weaving walker for so long."""

    async def main(loop: LockstepLoop) -> Flown:
        world, flown = World(loop, setup), Flown()
        world.eyes.glass_s = glass_s
        spoil(world)
        tasks = [loop.create_task(world.run()), loop.create_task(_station(world))]
        orders = Orders(world.flight)
        try:
            await asyncio.sleep(3.0)  # the attitude rate is known
            box = box_of(world.target.position_ned_m, world.vehicle.pose())
            assert box is not None
            await orders.perform(Select(box))
            await asyncio.sleep(0.8)
            world.target.weave_rad, world.target.speed_mps = 0.8, 3.0
            world.monitor.operator_confirms(loop.time())
            await orders.perform(Confirm())
        except GcsError as error:
            flown.refusal = str(error)
        for _ in range(round(20 * seconds)):
            await asyncio.sleep(0.05)
            tick = world.flight.tick
            assert tick is not None
            flown.states.append(tick.output.state)
            flown.causes.update(tick.output.reasons)
        status = world.flight.status()
        flown.line, flown.budget = status_line(status), status.budget
        flown.used_s, flown.estimate = world.flight.glass.used_s, world.flight.glass.estimate
        flown.unsafe = int(world.monitor.summary()["unsafe"])
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        return flown

    return lockstep.run(main)


async def _station(world: World) -> None:
    await world.wire.wait_vehicle(1.0)
    await world.flight.run()


def setup(glass_s: float | None, link_s: float = DELAY_S, **changes: object) -> Setup:
    config = Config(camera=camera_of(Lens(), glass_s))
    return replace(Setup(3, config=config, link=Conditions(delay_s=link_s)), **changes)  # type: ignore[arg-type]


def test_the_delay_is_found_in_flight_and_the_budget_tells_it() -> None:
    flown = fly(setup(None), 0.2, 14.0)
    assert flown.refusal == ""
    assert flown.states[-1] is State.FOLLOWING
    assert flown.unsafe == 0
    assert flown.estimate is not None
    assert flown.estimate.known
    assert flown.estimate.delay_s == pytest.approx(0.2, abs=0.02)
    assert flown.used_s == pytest.approx(0.2, abs=0.02)
    assert flown.budget is not None
    assert flown.budget.glass_s == pytest.approx(0.2, abs=0.02)
    assert flown.budget.link_s == pytest.approx(DELAY_S, abs=0.01)
    assert flown.budget.total_s == pytest.approx(0.2 + 0.02 + 0.025 + DELAY_S, abs=0.04)
    assert "latency 2" in flown.line
    assert "(glass " in flown.line


@pytest.mark.parametrize(("glass_s", "link_s"), [(0.42, DELAY_S), (0.22, 0.19)])
def test_a_command_too_late_is_refused_with_its_reason(glass_s: float, link_s: float) -> None:
    flown = fly(setup(glass_s, link_s), glass_s, 0.5)
    assert Cause.LATENCY.value in flown.refusal
    assert State.FOLLOWING not in flown.states


def test_a_little_less_is_not_refused() -> None:
    assert fly(setup(0.22, 0.05), 0.22, 0.5).refusal == ""


def test_slow_attitude_is_refused_with_its_reason() -> None:
    flown = fly(setup(0.06, attitude_rate_hz=3.0), 0.06, 0.5)
    assert Cause.ATTITUDE_SLOW.value in flown.refusal


def test_a_delay_found_to_be_too_long_ends_the_follow() -> None:
    """It begins with the prior; once the pictures have told that they are half a second old, they count no more."""
    flown = fly(setup(None), 0.45, 20.0)
    assert flown.refusal == ""
    assert State.FOLLOWING in flown.states
    assert flown.states[-1] is State.RELEASED
    assert Cause.TARGET_LOST in flown.causes
    assert flown.used_s > 0.3
    assert flown.unsafe == 0


@pytest.mark.parametrize("seed", [3, 4])
def test_a_delay_not_known_yet_is_no_wrong_camera(seed: int) -> None:
    """The picture turns 0.23 s later than the prior says: not mirrored, not on a gimbal."""
    flown = fly(setup(None, seed=seed), 0.33, 8.0)
    assert flown.states[-1] is State.FOLLOWING
    assert Cause.CAMERA_WRONG not in flown.causes


def test_a_mirrored_camera_is_found_though_the_delay_is_not_given() -> None:
    def mirror(world: World) -> None:
        world.eyes.distort = lambda box, now_s: replace(box, cx_px=world.eyes.lens.width_px - box.cx_px)

    flown = fly(setup(None), 0.1, 6.0, mirror)
    assert Cause.CAMERA_WRONG in flown.causes
    assert flown.states[-1] is State.RELEASED
    assert flown.unsafe == 0

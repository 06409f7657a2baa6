"""The pilot takes over at random times (P7), and a link that is bad for long (P10)."""

from __future__ import annotations

import pytest

from gcs.lockstep.world import DELAY_S
from sitl_mocks.link_faults import Conditions
from sitl_mocks.vehicle import Mode
from tests.faults import break_link, break_vehicle
from tests.faults.script import Expect, Fault, Happened, Phase, fly
from tests.faults.world import FaultWorld

_TAKEOVERS = 10  # of each autopilot; `python -m tests.faults --only H15 --pairs no --seeds 200` does a thousand


@pytest.mark.parametrize("autopilot", [0, 1])
def test_no_setpoint_leaves_a_tenth_of_a_second_after_the_pilot_has_it(autopilot: int) -> None:
    fault = Fault(15, "pilot takes over", Expect.TAKEN_OVER, break_vehicle.pilot_takes_over, 0.1, watch_s=1.0)
    for number in range(_TAKEOVERS):
        outcome = fly(fault, (Phase.ACCELERATING, Phase.STEADY, Phase.COASTING)[number % 3], 2 * number + autopilot)
        assert outcome.problems == ()


@pytest.mark.parametrize("autopilot", [0, 1])
def test_only_a_request_that_is_under_way_can_overtake_the_pilot(autopilot: int) -> None:
    """Both autopilots obey whoever spoke last; a pilot who spoke 0.1 s before our request leaves is heard first."""
    overtaken_s: list[float] = []
    spoke: list[float] = []

    def inject(world: FaultWorld) -> Happened:
        if world.vehicle.autopilot.mode is Mode.EXTERNAL:
            return lambda: True
        spoke.append(world.loop.time())
        world.vehicle.pilot_sets_mode(Mode.ALTITUDE)

        def watch(now_s: float) -> None:
            if world.vehicle.autopilot.mode is Mode.EXTERNAL:
                overtaken_s.append(now_s - spoke[-1])
                world.hooks.remove(watch)

        world.hooks.append(watch)
        return lambda: True

    fault = Fault(15, "pilot is first", Expect.SAFE, inject, watch_s=1.0)
    for number in range(_TAKEOVERS):
        assert fly(fault, Phase.ENGAGING, 2 * number + autopilot).problems == ()
    assert len(spoke) > 3
    assert max(overtaken_s, default=0.0) <= 0.1


def _bad(loss_frac: float, delay_s: float) -> Fault:
    def inject(world: FaultWorld) -> Happened:
        return break_link.make_bad(world, Conditions(loss_frac, DELAY_S + delay_s))

    expect = Expect.GOES_ON if delay_s == 0.0 else Expect.ENDED
    return Fault(13, f"{loss_frac:.0%} lost, {delay_s:g} s late", expect, inject, watch_s=5.0)


def test_with_a_fifth_of_the_datagrams_lost_following_goes_on() -> None:
    """PX4 beats once a second: now and then three in a row are lost, and then it must be released, safely."""
    outcomes = [fly(_bad(0.2, 0.0), Phase.STEADY, seed) for seed in range(12)]
    assert [outcome.unsafe for outcome in outcomes] == [0] * len(outcomes)
    assert sum(outcome.went_on for outcome in outcomes) >= 11


@pytest.mark.parametrize("seed", range(2))
def test_with_half_lost_and_half_a_second_late_it_holds(seed: int) -> None:
    assert fly(_bad(0.5, 0.5), Phase.STEADY, seed).problems == ()

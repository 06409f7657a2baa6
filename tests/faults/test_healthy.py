"""The twin of all faults: nothing is wrong, so nothing may stop, pause or be trimmed (A1, P14)."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

import pytest

from control.gate import Reason
from sitl_mocks.vehicle import Personality
from tests.faults import lockstep
from tests.faults.lockstep import LockstepLoop
from tests.faults.script import Flown, engage
from tests.faults.world import Setup, World

_FIRST_S = 1.0  # the gate's word counts once the follow runs
_TRIMMED = (Reason.SPEED, Reason.ALTITUDE, Reason.FENCE, Reason.SLEW, Reason.LIMIT_JUMPED)


@dataclass
class Healthy:
    """What ten minutes came to."""

    states: set[str] = field(default_factory=set)
    gates: dict[Reason, int] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    max_gap_s: float = 0.0
    moved_m: float = 0.0


class _Turning:
    """The target turns round before it gets far: inside the fence for ever."""

    def __init__(self, world: World) -> None:
        self._world = world

    def __call__(self, now_s: float) -> None:
        north, east, _ = self._world.target.position_ned_m
        self._world.target.heading_rad += 0.0025 if abs(north) + abs(east) > 40.0 else 0.0004


def fly_healthy(personality: Personality, seed: int, seconds: float) -> Healthy:
    """Follow for so long."""

    async def main(loop: LockstepLoop) -> Healthy:
        world, found, flown = World(loop, Setup(seed, personality)), Healthy(), Flown()
        stepping = loop.create_task(world.run())
        await world.wire.wait_vehicle(1.0)
        flight = loop.create_task(world.flight.run())
        await engage(world, flown, lambda: None)
        assert not flown.refusal
        world.target.speed_mps = 2.5
        world.hooks.append(_Turning(world))
        await asyncio.sleep(_FIRST_S)
        world.monitor.availability.healthy = True
        end_s, start = loop.time() + seconds, world.target.position_ned_m
        while loop.time() < end_s:
            tick = await world.flight.next_tick()
            found.states.add(tick.output.state.value)
            found.gates[tick.gate] = found.gates.get(tick.gate, 0) + 1
            found.moved_m = max(found.moved_m, abs(world.target.position_ned_m[0] - start[0]))
        found.problems = [f"{r.rule.value} at {r.t_s:.2f} s: {r.text}" for r in world.monitor.reasons]
        found.max_gap_s = world.monitor.max_gap_s
        stepping.cancel()
        flight.cancel()
        await asyncio.gather(stepping, flight, return_exceptions=True)
        return found

    return lockstep.run(main)


@pytest.mark.parametrize("personality", list(Personality))
@pytest.mark.parametrize("seed", [1, 2])
def test_a_healthy_flight_is_flown_without_a_pause_a_hold_or_a_trim(personality: Personality, seed: int) -> None:
    found = fly_healthy(personality, seed, 150.0)
    assert found.problems == []
    assert found.states == {"following"}
    assert found.max_gap_s <= 0.15
    assert found.moved_m > 10.0
    assert {gate.value: count for gate, count in found.gates.items() if gate in _TRIMMED} == {}

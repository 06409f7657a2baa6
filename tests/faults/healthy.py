"""The twin of all faults: a flight in which nothing is wrong."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

from control.gate import Reason
from gcs.lockstep import loop as lockstep
from gcs.lockstep.loop import LockstepLoop
from gcs.lockstep.world import Setup
from sitl_mocks.vehicle import Personality
from tests.faults.script import Flown, engage
from tests.faults.world import FaultWorld

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

    def __init__(self, world: FaultWorld) -> None:
        self._world = world

    def __call__(self, now_s: float) -> None:
        north, east, _ = self._world.target.position_ned_m
        self._world.target.heading_rad += 0.0025 if abs(north) + abs(east) > 40.0 else 0.0004


def fly_healthy(personality: Personality, seed: int, seconds: float) -> Healthy:
    """Follow for so long."""

    async def main(loop: LockstepLoop) -> Healthy:
        world, found, flown = FaultWorld(loop, Setup(seed, personality)), Healthy(), Flown()
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


def problems(found: Healthy) -> list[str]:
    """What a healthy flight must not have: an unsafe outcome, a pause, a hold, a trim (A1, P14)."""
    trims = [f"the gate {gate.value}, {count} times" for gate, count in found.gates.items() if gate in _TRIMMED]
    states = [f"was {state}" for state in sorted(found.states - {"following"})]
    gap = [f"no setpoint for {found.max_gap_s:.3f} s"] if found.max_gap_s > 0.15 else []
    return [*found.problems, *trims, *states, *gap, *(["the target stood still"] if found.moved_m < 10.0 else [])]

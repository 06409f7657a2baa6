"""The harness itself: same seed, same bytes; a judge that fires; a fault that must have happened."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import pytest

from gcs.lockstep import loop as lockstep
from gcs.lockstep.loop import LockstepLoop
from tests.faults import break_video
from tests.faults.hazards import FAULTS
from tests.faults.script import Expect, Fault, Phase, fly
from tests.faults.world import FaultWorld


def _nothing(world: FaultWorld) -> object:
    return lambda: True


HEALTHY = Fault(0, "nothing", Expect.GOES_ON, _nothing)


def test_time_jumps_to_the_next_timer_and_time_outs_work() -> None:
    async def main(loop: LockstepLoop) -> list[float]:
        times = [loop.time()]
        await asyncio.sleep(3600.0)
        times.append(loop.time())
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(asyncio.Event().wait(), 5.0)
        assert await asyncio.to_thread(lambda: 7) == 7
        return [*times, loop.time()]

    start_s, slept_s, out_s = lockstep.run(main)
    assert slept_s == pytest.approx(start_s + 3600.0)
    assert out_s == pytest.approx(slept_s + 5.0)


def test_a_loop_where_nothing_will_ever_happen_says_so() -> None:
    async def main(loop: LockstepLoop) -> None:
        await asyncio.Event().wait()

    with pytest.raises(RuntimeError, match="nothing would ever happen"):
        lockstep.run(main)


@pytest.mark.parametrize("seed", [0, 1])
def test_the_same_seed_gives_the_same_bytes(seed: int) -> None:
    first, again, other = (fly(HEALTHY, Phase.STEADY, s) for s in (seed, seed, seed + 2))
    assert first == again
    assert first.digest != other.digest


def test_a_fault_that_did_not_happen_fails_the_run() -> None:
    outcome = fly(replace(HEALTHY, inject=lambda world: lambda: False), Phase.STEADY, 0)
    assert outcome.problems == ("the fault did not happen",)


def test_a_missed_bound_fails_the_run() -> None:
    strict = Fault(1, "video lost", Expect.RELEASED, break_video.video_lost, 0.4, watch_s=6.0)
    outcome = fly(strict, Phase.STEADY, 0)
    assert outcome.unsafe
    assert any("last moving setpoint" in problem for problem in outcome.problems)


def test_a_follow_that_should_have_ended_fails_the_run() -> None:
    outcome = fly(replace(HEALTHY, expect=Expect.RELEASED), Phase.STEADY, 1)
    assert any("expected released" in problem for problem in outcome.problems)


def test_every_hazard_is_in_the_table_or_said_to_be_elsewhere() -> None:
    from tests.faults.hazards import ELSEWHERE

    assert {fault.hazard for fault in FAULTS} | set(ELSEWHERE) == set(range(1, 41))

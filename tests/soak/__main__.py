"""`python -m tests.soak`: a long flight with everything that happens on one, and what it costs.

On a fake clock, as fast as the machine goes: an hour by default. With --real it flies in real time instead: a
station of its own process with the real network, a real socket, the recorder on. Fails on an unsafe outcome, on
memory that grows by more than 1 MB an hour after the first sixth, and on handles or tasks that pile up.
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import math
import random
import sys
import tempfile
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from tqdm import tqdm

from control.engagement import State
from gcs.errors import GcsError
from gcs.flight_orders import Orders
from gcs.lockstep import loop as lockstep
from gcs.lockstep.eyes import box_of
from gcs.lockstep.world import Setup
from gcs.operator.orders import Acknowledge, Confirm, Select
from sitl_mocks.vehicle import Mode, Personality
from tests.faults.world import FaultWorld
from tests.processes.rig import station, vehicle
from tests.soak.samples import Sample, growth, sample, slope_mb_per_h
from tracker.box import Box

_EVERY_S: Final = 30.0
_TICKS: Final = 20_000  # the newest; never more, so that keeping them is no growth
_SLOPE_MB_PER_H: Final = 1.0


@dataclass
class Record:
    """What a soak has come to."""

    samples: list[Sample] = field(default_factory=list)
    ticks_s: deque[float] = field(default_factory=lambda: deque([0.0] * _TICKS, maxlen=_TICKS))  # each one's duration
    follows: int = 0
    losses: int = 0
    takeovers: int = 0
    refusals: Counter[str] = field(default_factory=Counter)
    unsafe: int = 0
    reasons: str = ""

    def problems(self) -> list[str]:
        """What a long flight must not show."""
        settled = self.samples[len(self.samples) // 6 :]
        found = [f"{self.unsafe} unsafe outcomes: {self.reasons}"] if self.unsafe else []
        if (slope := slope_mb_per_h(settled)) > _SLOPE_MB_PER_H:
            found.append(f"memory grows by {slope:.2f} MB/h")
        return found + [
            f"{name} from {low} to {high}" for name, (low, high) in growth(settled).items() if high > low + 3
        ]

    def table(self, name: str, flown_s: float, wall_s: float) -> str:
        """For people."""
        settled = self.samples[len(self.samples) // 6 :]
        p50, p99, worst = (1000 * v for v in (*np.percentile(self.ticks_s, [50, 99]), max(self.ticks_s)))
        counts = ", ".join(f"{what} {low}..{high}" for what, (low, high) in growth(settled).items())
        return (
            f"{name}: {flown_s / 60:.0f} min flown in {wall_s / 60:.1f}\n"
            f"  follows {self.follows}, losses {self.losses}, takeovers {self.takeovers}, unsafe {self.unsafe}\n"
            f"  memory {settled[0].rss_mb:.1f} to {settled[-1].rss_mb:.1f} MB, {slope_mb_per_h(settled):+.2f} MB/h\n"
            f"  {counts}\n"
            f"  refusals {dict(self.refusals) or 0}\n"
            f"  tick: median {p50:.2f}, p99 {p99:.2f}, worst {worst:.2f} ms of {len(self.ticks_s)}"
        )


# -- on the fake clock ------------------------------------------------------------------------------------


async def simulated(loop: lockstep.LockstepLoop, seconds: float, seed: int) -> Record:
    """Follow, lose, be taken over, and begin again."""
    personality = list(Personality)[seed % 2]
    world, record, rng = FaultWorld(loop, Setup(seed, personality)), Record(), random.Random(seed)
    decide = world.flight.step

    def timed(now_s: float) -> object:
        begun_s = time.perf_counter()
        tick = decide(now_s)
        record.ticks_s.append(time.perf_counter() - begun_s)
        return tick

    world.flight.step = timed  # type: ignore[method-assign, assignment]
    start_s = loop.time()
    tasks = [loop.create_task(world.run()), loop.create_task(world.flight.run())]
    with tqdm(total=round(seconds), unit="s", desc=personality.value, file=sys.stderr) as bar:
        while (flown_s := loop.time() - start_s) < seconds:
            await _episode(world, record, rng)
            _forget(world)
            if not record.samples or flown_s - record.samples[-1].t_s >= _EVERY_S:
                gc.collect()
                record.samples.append(sample(flown_s, tasks=len(asyncio.all_tasks())))
            bar.update(round(flown_s) - bar.n)
    summary = world.monitor.summary()
    record.unsafe, record.reasons = summary["unsafe"], str(summary["reasons"][:3])
    for task in tasks:
        task.cancel()
    return record


async def _episode(world: FaultWorld, record: Record, rng: random.Random) -> None:
    """One follow, from the box to its end."""
    orders = Orders(world.flight)
    world.vehicle.autopilot.change_mode(Mode.HOLD if world.px4 else Mode.BRAKE)
    world.vehicle.autopilot.flight.body.motion.position_ned_m = (0.0, 0.0, -9.0)  # wherever the last one ended
    yaw_rad = world.vehicle.pose().yaw_rad
    world.target.position_ned_m = (15.0 * math.cos(yaw_rad), 15.0 * math.sin(yaw_rad), -0.8)
    world.target.heading_rad = yaw_rad + rng.uniform(-0.5, 0.5)
    world.target.speed_mps, world.eyes.hidden = 0.0, False
    await asyncio.sleep(4.0)
    try:
        await orders.perform(Acknowledge())
        await orders.perform(Select(box_of(world.target.position_ned_m, world.vehicle.pose()) or Box(320, 240, 60, 60)))
        await asyncio.sleep(0.6)
        world.monitor.operator_confirms(world.loop.time())
        await orders.perform(Confirm())
    except GcsError as error:
        record.refusals[str(error)] += 1
        return
    record.follows += 1
    world.target.speed_mps = rng.uniform(0.5, 3.0)
    for _ in range(rng.randrange(1, 5)):
        await asyncio.sleep(rng.uniform(2.0, 8.0))
        world.eyes.hidden = True
        await asyncio.sleep(rng.uniform(0.1, 0.8))
        world.eyes.hidden = False
    if rng.random() < 0.5:
        world.eyes.hidden = True
        await asyncio.sleep(4.5)
        record.losses += 1
    else:
        world.vehicle.pilot_sets_mode(Mode.RETURN)
        await asyncio.sleep(1.0)
        record.takeovers += 1
    tick = world.flight.tick
    assert tick is not None
    assert tick.output.state in (State.RELEASED, State.TAKEN_OVER), tick.output


def _forget(world: FaultWorld) -> None:
    """What the harness keeps for its judgement must not be taken for a leak of the station."""
    world.exit.setpoints.clear()
    world.said.clear()


# -- in real time -----------------------------------------------------------------------------------------


async def real(minutes: float) -> Record:
    """The whole station in a process of its own."""
    record = Record()
    with tempfile.TemporaryDirectory() as folder:
        async with vehicle(Personality.PX4) as w, station(w.url, "--network", "--out", folder) as s:
            await s.follows(w)
            record.follows, begun_s = 1, time.monotonic()
            for _ in tqdm(range(round(minutes * 12)), desc="real time", unit="5 s", file=sys.stderr):
                await asyncio.sleep(5.0)
                record.samples.append(sample(time.monotonic() - begun_s, s.process.pid))
                w.heard.clear()
            gaps = (await s.does("gaps"))["answer"][20:]
            record.ticks_s = deque(max(gap - 0.05, 0.0) for gap in gaps)
            summary = w.monitor.summary()
            record.unsafe, record.reasons = summary["unsafe"], str(summary["reasons"][:3])
            if w.mode is not Mode.EXTERNAL:
                record.unsafe, record.reasons = (
                    record.unsafe + 1,
                    f"the follow ended: {[x for x in s.lines if 'state' in x][-3:]}",
                )
    return record


def main() -> int:
    """0 where nothing grew and nothing was unsafe."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0, help="of flight")
    parser.add_argument("--real", action="store_true", help="in real time, a real process and a real socket")
    given = parser.parse_args()
    failed = False
    runs: list[tuple[str, Callable[[], Record]]]
    if given.real:
        runs = [("real time", lambda: asyncio.run(real(given.minutes)))]
    else:
        seconds = given.minutes * 30  # two autopilots share it
        runs = [
            (p.value, lambda seed=seed: lockstep.run(lambda loop: simulated(loop, seconds, seed)))  # type: ignore[misc]
            for seed, p in enumerate(Personality)
        ]
    for name, fly in runs:
        begun_s = time.monotonic()
        record = fly()
        print(record.table(name, record.samples[-1].t_s, time.monotonic() - begun_s))
        for problem in record.problems():
            failed = True
            print(f"  FAILED: {problem}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

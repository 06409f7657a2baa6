"""`python -m tests.processes.latency`: how late the 20 Hz tick is while the tracker works, and an abort on the wire.

Measured on a whole station of its own process with the real network at 20 pictures a second, seen from the vehicle.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
import time

import numpy as np
from tqdm import tqdm

from sitl_mocks.vehicle import Personality
from tests.processes.rig import Station, Wired, station, vehicle

_TICK_S = 0.05


def _figures(name: str, values_s: list[float]) -> str:
    p50, p99, worst = (1000 * v for v in (*np.percentile(values_s, [50, 99]), max(values_s)))
    return f"{name}: median {p50:.1f}, p99 {p99:.1f}, worst {worst:.1f} ms of {len(values_s)}"


async def _abort(s: Station, w: Wired) -> float:
    """Time from the order to the first setpoint that is zero."""
    asked_s = s.tell("abort")
    await w.until(lambda: any(not h.moving for h in w.setpoints(asked_s)))
    zero_s = next(h.t_s for h in w.setpoints(asked_s) if not h.moving)
    await w.until(lambda: w.holds)
    return zero_s - asked_s


async def measure(seconds: float, presses: int) -> None:
    async with vehicle(Personality.PX4) as w, station(w.url, "--network") as s:
        await s.follows(w)
        begun_s = time.monotonic()
        await asyncio.sleep(seconds)
        answer = await s.does("gaps")
        gaps_s = answer["answer"][-int(seconds / _TICK_S) :]
        print(_figures("tick lag", [max(gap - _TICK_S, 0.0) for gap in gaps_s]))
        arrivals = [h.t_s for h in w.setpoints(begun_s)]
        print(_figures("gap between setpoints", list(np.diff(arrivals))))
        delays_s = []
        for _ in tqdm(range(presses), desc="aborts", file=sys.stderr):
            delays_s.append(await _abort(s, w))
            await s.does("acknowledge")
            await asyncio.sleep(0.3)
            moving = w.monitor.moving_setpoints
            await s.confirms(w)
            await w.until(lambda moving=moving: w.monitor.moving_setpoints > moving)  # type: ignore[misc]
            w.heard.clear()
        print(_figures("abort to zero on the wire", delays_s))
        print(f"unsafe outcomes: {w.monitor.summary()['unsafe']}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m tests.processes.latency", description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0, help="of following")
    parser.add_argument("--presses", type=int, default=100, help="of the abort key")
    given = parser.parse_args()
    asyncio.run(measure(given.seconds, given.presses))

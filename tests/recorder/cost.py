"""`python -m tests.recorder.cost`: what recording costs a station, and whether the 20 Hz tick comes later for it.

Whole stations in processes of their own that follow, with the real network on every picture of a JPEG stream; with
and without a record in turn, so that a busy machine is busy for both.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from tqdm import tqdm

from control.gate import TICK_S
from tests.processes.rig import station, vehicle
from tests.recorder.kill import camera

_WRITERS = ("messages.jsonl", "flight.tlog", "film")


@dataclass
class Runs:
    """Of one kind. late_ms: of each tick; cores: of the whole process, and of the threads that write."""

    late_ms: list[float] = field(default_factory=list)
    cores: list[float] = field(default_factory=list)
    writers: list[dict[str, float]] = field(default_factory=list)
    written_bytes: int = 0


async def run(runs: Runs, folder: Path | None, seconds: float) -> None:
    """One flight."""
    out = () if folder is None else ("--out", str(folder))
    async with vehicle() as w, camera() as url, station(w.url, "--network", "--video", url, *out) as s:
        await s.follows(w)
        await asyncio.sleep(1.0)
        before = (await s.does("cpu"))["answer"]
        await asyncio.sleep(seconds)
        after = (await s.does("cpu"))["answer"]
        gaps_s = (await s.does("gaps"))["answer"][-int(seconds / TICK_S) :]
    runs.late_ms += [max(gap_s - TICK_S, 0.0) * 1000 for gap_s in gaps_s]
    used = {name: (after[name] - before.get(name, 0.0)) / seconds for name in after}
    runs.cores.append(used["all"])
    runs.writers.append({name: used[name] for name in _WRITERS if name in used})
    if folder is not None:
        runs.written_bytes += sum(path.stat().st_size for path in folder.iterdir())


def _row(name: str, runs: Runs) -> str:
    p50, p99 = np.percentile(runs.late_ms, [50, 99])
    return (
        f"{name:8} tick late p50 {p50:.2f}, p99 {p99:.2f}, most {max(runs.late_ms):.1f} ms of {len(runs.late_ms)}; "
        f"process {np.mean(runs.cores):.3f} of a core"
    )


async def measure(seconds: float, rounds: int) -> None:
    """Prints it."""
    without, with_record = Runs(), Runs()
    for _ in tqdm(range(rounds), desc="rounds", file=sys.stderr):
        await run(without, None, seconds)
        with tempfile.TemporaryDirectory() as folder:
            await run(with_record, Path(folder) / "flight", seconds)
    print(_row("without", without))
    print(_row("recorded", with_record))
    for name in with_record.writers[0]:
        print(f"  {name:15} {100 * np.mean([each[name] for each in with_record.writers]):.2f} % of a core")
    total = 100 * np.mean([sum(each.values()) for each in with_record.writers])
    print(f"  all that write  {total:.2f} % of a core; {with_record.written_bytes / rounds / 1e6:.1f} MB a flight")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m tests.recorder.cost", description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of following, each time")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    asyncio.run(measure(given.seconds, given.rounds))

"""Worker processes side by side, each on a share of the numbers; one that dies or hangs is a problem, then replaced."""

from __future__ import annotations

import asyncio
import json
import os
import sys
from collections import Counter
from dataclasses import dataclass, field
from typing import Any, Final

from tests.fuzz.report import Progress, Row

_HANG_S: Final = 60.0
_GROWTH_MB: Final = 40.0  # of one worker, from a fifth of its share to its end
_PEAK_MB: Final = 1500.0
_WARM_FRAC: Final = 0.2
# As the command line sets it, before OpenCV is imported; one thread, like one decoder of a flight.
_ENVIRONMENT: Final = {"OPENCV_IO_MAX_IMAGE_PIXELS": str(4096 * 2160), "OMP_NUM_THREADS": "1"}


@dataclass(slots=True)
class _Share:
    """One worker's numbers, and what it said."""

    first: int
    end: int
    at: int = -1
    warm: dict[str, Any] | None = None
    last: dict[str, Any] = field(default_factory=dict)


def supervise(what: str, kind: str, count: int, seed: int, *, jobs: int = 2, quiet: bool = True) -> Row:
    """Try `count` damaged files of this kind (see tests.fuzz.worker)."""
    row, progress, done = Row(what), Progress(what, count, quiet), Counter[str]()
    size = -(-count // jobs)
    shares = [_Share(first, min(first + size, count)) for first in range(0, count, size)]

    async def run() -> None:
        await asyncio.gather(*(_work(share, kind, seed, row, progress, done) for share in shares))

    asyncio.run(run())
    row.count, row.seconds = sum(done.values()), progress.seconds
    row.rss_warm_mb = max(share.warm["rss_mb"] if share.warm else 0.0 for share in shares)
    row.rss_end_mb = max(share.last.get("rss_mb", 0.0) for share in shares)
    peak_mb = max(share.last.get("peak_mb", 0.0) for share in shares)
    row.note = f"{done['worked']} readable, {done['refused']} refused in one line, peak {peak_mb:.0f} MB"
    if peak_mb > _PEAK_MB:
        row.problem(f"{peak_mb:.0f} MB were taken at once")
    if count > 100 and not (done["worked"] and done["refused"]):
        row.problem("all came out alike: the damage was not put to the test")
    return row


async def _work(share: _Share, kind: str, seed: int, row: Row, progress: Progress, done: Counter[str]) -> None:
    first = share.first
    while first < share.end:
        share.warm = None
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "tests.fuzz.worker", kind, str(seed), str(first), str(share.end),
            stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL, env=os.environ | _ENVIRONMENT,
        )  # fmt: skip
        problem = await _listen(process, share, row, progress, done)
        if problem:
            process.kill()
        status = await process.wait()
        _check_growth(share, row)
        if not problem and status == 0:
            return
        row.problem(f"{kind} {seed} {share.at}: {problem or f'the process ended with status {status}'}")
        first = max(share.at, first) + 1  # one that dies at once is not started for ever


async def _listen(
    process: asyncio.subprocess.Process, share: _Share, row: Row, progress: Progress, done: Counter[str]
) -> str:
    """Until the worker ends; what is wrong with it if it does not."""
    assert process.stdout is not None
    while True:
        try:
            line = await asyncio.wait_for(process.stdout.readline(), _HANG_S)
        except TimeoutError:
            return f"nothing for {_HANG_S:g} s"
        if not line:
            return ""
        said = json.loads(line)
        share.at = said.get("begin", share.at)
        if "fault" in said:
            row.problem(f"number {share.at}: {said['fault']}")
        if "end" in said:
            share.last = said
            done["worked" if said["worked"] else "refused"] += 1
            if said["problem"]:
                row.problem(f"number {share.at} ({said['kind']}): {said['problem']}")
            if share.warm is None and share.at >= share.first + _WARM_FRAC * (share.end - share.first):
                share.warm = said
            progress.at(sum(done.values()))


def _check_growth(share: _Share, row: Row) -> None:
    warm, last = share.warm, share.last
    if warm is None or not last:
        return
    if last["rss_mb"] - warm["rss_mb"] > _GROWTH_MB:
        row.problem(f"memory grew from {warm['rss_mb']:.0f} to {last['rss_mb']:.0f} MB")
    for what in ("handles", "threads"):
        if last[what] > warm[what] + 4:  # what the newest stream still holds comes and goes
            row.problem(f"{what}: {warm[what]} when warm, {last[what]} in the end")

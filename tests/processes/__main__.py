"""`python -m tests.processes`: every fault on both autopilots, measured, as a table; fails on any unsafe one."""

from __future__ import annotations

import argparse
import asyncio
import sys
import tempfile
from pathlib import Path

from sitl_mocks.vehicle import Personality
from tests.processes.faults import FAULTS, Row

_HEAD = "| fault | autopilot | bound | measured worst | unsafe | note |\n| --- | --- | --- | --- | --- | --- |"


async def _worst(name: str, personality: Personality, repeats: int) -> Row:
    rows = []
    for seed in range(repeats):
        with tempfile.TemporaryDirectory() as folder:
            rows.append(await FAULTS[name](personality, seed, Path(folder)))
    return max(rows, key=lambda row: (not row.passed, row.unsafe, row.measured))


async def _run(only: str, repeats: int) -> int:
    print(_HEAD)
    failed = 0
    for name in FAULTS:
        for personality in Personality:
            if only not in name:
                continue
            row = await _worst(name, personality, repeats)
            failed += not row.passed
            verdict = "" if row.passed else "FAILED: " + ("" if row.happened else "it did not happen; ") + row.reasons
            print(
                f"| {name} | {personality.value} | {row.bound:g} {row.unit} | {row.measured:.3g} {row.unit} "
                f"| {row.unsafe} | {verdict}{row.note} |",
                flush=True,
            )
    return 1 if failed else 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m tests.processes", description=__doc__)
    parser.add_argument("--only", default="", help="faults whose name holds this text")
    parser.add_argument("--repeats", type=int, default=1, help="times each, at other random moments")
    given = parser.parse_args()
    sys.exit(asyncio.run(_run(given.only, given.repeats)))

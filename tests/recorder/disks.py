"""`python -m tests.recorder.disks` (as root, on Linux): real disks that fill up or stand still under a real flight.

A small tmpfs, and an ext4 file system in a file that `fsfreeze` holds for two seconds, three times.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

from gcs.errors import GcsError
from gcs.recorder.manifest import read_manifest
from gcs.replay.log import FlightLog
from tests.processes.rig import Station, Wired, station, vehicle

_STALL_S = 2.0


def _do(*command: str) -> None:
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


@contextlib.contextmanager
def _mounted(*arguments: str) -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        _do("mount", *arguments, folder)
        try:
            yield Path(folder)
        finally:
            _do("umount", folder)


@contextlib.asynccontextmanager
async def _flight(disk: Path) -> AsyncIterator[tuple[Wired, Station]]:
    """It follows; afterwards it is ended in order."""
    async with vehicle() as w, station(w.url, "--out", str(disk / "flight")) as s:
        await s.follows(w)
        begun_s = time.monotonic()
        yield w, s
        arrivals_s = [heard.t_s for heard in w.setpoints(begun_s)]
        s.tell("quit")
        await asyncio.wait_for(s.process.wait(), 30.0)
    gap_s = max(b - a for a, b in itertools.pairwise(arrivals_s))
    unsafe = w.monitor.summary()["unsafe"]
    print(f"  longest gap between setpoints {1000 * gap_s:.0f} ms of {len(arrivals_s)}, unsafe outcomes {unsafe}")
    for line in s.lines:
        if "record" in line.get("said", ""):
            print(f"  said: {line['said']}")
    log = FlightLog(disk / "flight")
    print(f"  {log.span_s:.1f} s in the log, {log.dropped} messages missing, cut in a record: {log.is_cut}")
    try:
        print(f"  manifest: ended {read_manifest(disk / 'flight').ended}")
    except GcsError as error:
        print(f"  manifest: {error}")


async def _fill() -> None:
    print("a disk of 500 kB fills up")
    with _mounted("-t", "tmpfs", "-o", "size=500k", "tmpfs") as disk:
        async with _flight(disk):
            await asyncio.sleep(8.0)


async def _stall() -> None:
    print(f"a disk stands still for {_STALL_S:g} s, three times")
    with tempfile.NamedTemporaryFile() as image:
        image.truncate(100_000_000)
        _do("mkfs.ext4", "-q", image.name)
        with _mounted("-o", "loop", image.name) as disk:
            async with _flight(disk):
                for _ in range(3):
                    await asyncio.sleep(1.0)
                    await asyncio.to_thread(_do, "fsfreeze", "--freeze", str(disk))
                    await asyncio.sleep(_STALL_S)
                    await asyncio.to_thread(_do, "fsfreeze", "--unfreeze", str(disk))


if __name__ == "__main__":
    try:
        asyncio.run(_fill())
        asyncio.run(_stall())
    except (subprocess.CalledProcessError, FileNotFoundError) as error:
        sys.exit(f"it cannot be tried here: {error}")

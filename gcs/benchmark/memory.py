"""Peak resident memory of whole processes."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

from gcs.benchmark.timing import BenchError
from tracker.engines.catalogue import TORCH, available_engines

_UPDATES: Final = 30
_TRACK: Final = """\
import sys
from gcs.benchmark import films, trackers
film = films.sample({updates})
weights = next(each for each in trackers.shipped() if each.name == "compact")
tracker = weights.tracker(sys.argv[1], 1)
tracker.init(film.frames[0], film.box)
for frame in film.frames[1:]:
    tracker.update(frame)
"""
# A child is first charged with what its parent held; so the parent of what is measured is a small one.
_LAUNCH: Final = """\
import os, subprocess, sys
process = subprocess.Popen([sys.executable, *sys.argv[1:]], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
_, status, usage = os.wait4(process.pid, 0)
print(os.waitstatus_to_exitcode(status), usage.ru_maxrss)
"""


def measure(
    folder: Path, ticked: Callable[[str], None], note: Callable[[str], None], *, quick: bool
) -> dict[str, float]:
    """MiB by what ran."""
    wanted = {
        f"tracker, compact, {engine}": ["-c", _TRACK.format(updates=_UPDATES), engine]
        for engine in ((TORCH,) if quick else available_engines())
    }
    if not quick:
        wanted["dry run of the sample"] = ["-m", "gcs.cli", "dry-run", "--sample", "--out", str(folder / "dry-run")]
    found = {}
    for name, arguments in wanted.items():
        ticked(f"memory: {name}")
        try:
            found[name] = peak_mib(arguments)
        except BenchError as error:
            note(f"memory, {name}: {error}")
    return found


def peak_mib(arguments: list[str]) -> float:
    """Of this interpreter with these arguments. BenchError where it fails."""
    done = subprocess.run([sys.executable, "-c", _LAUNCH, *arguments], capture_output=True, text=True, check=True)
    status, peak_kib = map(int, done.stdout.split())
    if status:
        raise BenchError(f"the process ended with {status}")
    return peak_kib / 1024

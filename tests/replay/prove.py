"""Demo flights of all kinds, each recorded and flown again: `python -m tests.replay.prove [FLIGHTS]`, 40 s a flight.

Exit status 1 unless every one comes out to the last bit, from the pictures on; one that does not is kept in out/.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from itertools import cycle, islice, product
from pathlib import Path
from typing import Final

import msgspec

_SCENARIOS: Final = ("demo", "walk", "occlusion", "zigzag", "stop-and-go")
_KINDS: Final = tuple(product(_SCENARIOS, ("px4", "ardupilot"), ((), ("--gimbal",))))
_SECONDS: Final = 10


def fly(folder: Path, scenario: str, personality: str, extra: tuple[str, ...], seed: int) -> None:
    """Record one; what it came to is not what is judged here."""
    what = ["--scenario", scenario, "--personality", personality, "--seed", str(seed), "--seconds", str(_SECONDS)]
    command = [sys.executable, "-m", "gcs.cli", "demo", *what, *extra, "--json", "--out", str(folder)]
    subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)


def prove(folder: Path) -> dict[str, object]:
    """The verdict of `gcs replay --verify`."""
    command = [sys.executable, "-m", "gcs.cli", "replay", str(folder), "--verify", "--json"]
    ended = subprocess.run(command, capture_output=True, check=False)
    try:
        return dict(msgspec.json.decode(ended.stdout))
    except msgspec.DecodeError:
        return {"exact": False, "first": ended.stderr.decode().strip().splitlines()[-1:]}


def main(count: int) -> int:
    """A line for each flight."""
    exact = 0
    for seed, (scenario, personality, extra) in enumerate(islice(cycle(_KINDS), count), start=1):
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary) / "flight"
            fly(folder, scenario, personality, extra, seed)
            verdict = prove(folder)
            is_exact = bool(verdict["exact"])
            if not is_exact:
                shutil.copytree(folder, Path("out") / f"not-exact-{seed}", dirs_exist_ok=True)
        exact += is_exact
        said = f"exact: {verdict['compared']}" if is_exact else f"NOT: {verdict}"
        print(f"{seed:3d} {scenario} {personality} {' '.join(extra)} {said}", flush=True)
    print(f"{exact} of {count} to the last bit")
    return 0 if exact == count else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 20))

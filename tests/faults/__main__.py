"""The fault campaign: `python -m tests.faults`; 1 if anything was unsafe or a bound was missed."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from tqdm import tqdm

from sitl_mocks.vehicle import Personality
from tests.faults.campaign import Row, all_pairs, markdown, run_all, singles, table
from tests.faults.hazards import ELSEWHERE, FAULTS
from tests.faults.healthy import fly_healthy, problems
from tests.faults.script import Phase


def _hazard(text: str) -> int:
    hazards = {fault.hazard for fault in FAULTS}
    number = text.upper().removeprefix("H")
    if not number.isdecimal() or int(number) not in hazards:
        elsewhere = f": {ELSEWHERE[int(number)]}" if number.isdecimal() and int(number) in ELSEWHERE else ""
        raise argparse.ArgumentTypeError(f"{text!r} is none of the hazards broken here{elsewhere}")
    return int(number)


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__)
    parser.add_argument("--seeds", type=int, default=20, help="runs of each fault in each phase")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--phases", nargs="*", choices=[phase.name.lower() for phase in Phase], default=None)
    parser.add_argument("--only", nargs="*", type=_hazard, metavar="H9", help="these hazards")
    parser.add_argument("--pairs", choices=("too", "only", "no"), default="too", help="every two faults once")
    parser.add_argument("--healthy-min", type=float, default=10.0, help="simulated minutes in which nothing is wrong")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, default=Path("out/faults"))
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly, print the table, write it as Markdown and JSON."""
    options = _options(arguments)
    faults = [fault for fault in FAULTS if not options.only or fault.hazard in options.only]
    phases = [Phase[name.upper()] for name in options.phases] if options.phases else list(Phase)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    jobs = singles(faults, phases, seeds) if options.pairs != "only" else []
    jobs += all_pairs(faults) if options.pairs != "no" else []
    rows = table(run_all(jobs, options.jobs))
    text = markdown(rows) + "".join(f"\nH{number}: {why}" for number, why in ELSEWHERE.items()) + "\n"
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "faults.md").write_text(text)
    (options.out / "faults.json").write_text(json.dumps([asdict(row) for row in rows], indent=1))
    print(text)
    return max(_verdict(rows), _healthy(options.healthy_min))


def _healthy(minutes: float) -> int:
    """The availability twin, on both autopilots."""
    if minutes <= 0:
        return 0
    found = {kind.value: problems(fly_healthy(kind, 7, 30.0 * minutes)) for kind in tqdm(Personality, unit="flight")}
    for name, wrong in found.items():
        print(f"healthy, {name}, {minutes / 2:g} min: {'; '.join(wrong) or 'no gap over 150 ms, no hold, no trim'}")
    return int(any(found.values()))


def _verdict(rows: Sequence[Row]) -> int:
    for row in rows:
        for example in row.examples:
            print(f"{row.label}: {example}")
    runs, unsafe, failed = (sum(getattr(row, name) for row in rows) for name in ("runs", "unsafe", "failed"))
    print(f"{runs} runs, {unsafe} with an unsafe outcome, {failed} failed")
    return 1 if unsafe or failed else 0


if __name__ == "__main__":
    sys.exit(main())

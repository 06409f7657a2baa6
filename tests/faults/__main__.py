"""The fault campaign: `python -m tests.faults`; 1 if anything was unsafe or a bound was missed."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from tests.faults.campaign import Row, all_pairs, markdown, run_all, singles, table
from tests.faults.hazards import ELSEWHERE, FAULTS
from tests.faults.script import Phase


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__)
    parser.add_argument("--seeds", type=int, default=20, help="runs of each fault in each phase")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--phases", nargs="*", choices=[phase.name.lower() for phase in Phase], default=None)
    parser.add_argument("--only", nargs="*", metavar="H9", help="these hazards")
    parser.add_argument("--pairs", choices=("too", "only", "no"), default="too", help="every two faults once")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, default=Path("out/faults"))
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly, print the table, write it as Markdown and JSON."""
    options = _options(arguments)
    wanted = {int(name.lstrip("Hh")) for name in options.only or ()}
    faults = [fault for fault in FAULTS if not wanted or fault.hazard in wanted]
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
    return _verdict(rows)


def _verdict(rows: Sequence[Row]) -> int:
    for row in rows:
        for example in row.examples:
            print(f"{row.label}: {example}")
    runs, unsafe, failed = (sum(getattr(row, name) for row in rows) for name in ("runs", "unsafe", "failed"))
    print(f"{runs} runs, {unsafe} with an unsafe outcome, {failed} failed")
    return 1 if unsafe or failed else 0


if __name__ == "__main__":
    sys.exit(main())

"""The whole fuzz campaign: progress on standard error, then a table; exit status 1 if anything is wrong with it.

python -m tests.fuzz [--packets N] [--videos N] [--configs N] [--weights N] [--flights N] [--requests N] [--seed N]
                     [--jobs N]
"""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
from pathlib import Path

from sitl_mocks.vehicle import Personality
from tests.fuzz.configs import fuzz_configs
from tests.fuzz.link import fuzz_link
from tests.fuzz.listeners import fuzz_listeners
from tests.fuzz.report import Row, table
from tests.fuzz.supervise import supervise


def main() -> int:
    """Every kind in turn; a count of 0 leaves one out."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument("--packets", type=int, default=1_000_000, help="damaged MAVLink packets, both autopilots")
    parser.add_argument("--videos", type=int, default=10_000, help="damaged video files, folders and streams")
    parser.add_argument("--configs", type=int, default=5_000, help="configurations")
    parser.add_argument("--weights", type=int, default=1_000, help="damaged weights files and manifests")
    parser.add_argument("--flights", type=int, default=2_000, help="damaged flight folders, each read in two ways")
    parser.add_argument("--requests", type=int, default=5_000, help="damaged requests, to each of what listens")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2, help="processes that open damaged files")
    options = parser.parse_args()
    logging.disable(logging.WARNING)  # the signed link warns of forgeries, as it should
    rows, seed = list[Row](), options.seed
    with tempfile.TemporaryDirectory() as name:
        for number, personality in enumerate(Personality if options.packets else ()):
            count = options.packets // len(Personality)
            rows.append(fuzz_link(count, seed + number, personality, Path(name), quiet=False))
        files = ("videos", options.videos), ("weights", options.weights), ("flights", options.flights)
        for kind, count in files:
            if count:
                rows.append(supervise(kind, kind, count, seed, jobs=options.jobs, quiet=False))
        if options.configs:
            rows.append(fuzz_configs(options.configs, seed, Path(name), quiet=False))
    rows += fuzz_listeners(options.requests, seed, quiet=False) if options.requests else []
    sys.stdout.write(f"{table(rows)}\nseed {seed}\n")
    return 1 if any(row.problem_count for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())

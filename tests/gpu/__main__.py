"""`python -m tests.gpu`: how fast, and how far from the reference, the tracker is on this machine's GPU.

Needs an NVIDIA GPU and nothing but the repository; --cpu runs the same on the CPU, shorter, to see that it works.
Exit code 0; 1: an engine is further from the reference than it may be; 2: no GPU, or unusable arguments.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import torch

from tests.gpu.run import Settings, run
from tests.gpu.variants import COMPILED, VARIANTS


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.gpu", description=__doc__)
    parser.add_argument("--seconds", type=float, default=300.0, help="to take in all, about (default 300)")
    parser.add_argument("--json", type=Path, help="where to write all figures")
    parser.add_argument("--only", action="append", default=[], metavar="TEXT", help="variants whose name holds this")
    parser.add_argument("--network", choices=("full", "compact"), help="only this one")
    parser.add_argument(
        "--cpu", action="store_true", help="on the CPU, with compact and few frames: a check of the code"
    )
    parser.add_argument("--here", action="store_true", help="compile in this process (the command itself uses this)")
    given = parser.parse_args(arguments)
    if not given.cpu and not torch.cuda.is_available():
        print("no CUDA GPU here: nothing to measure (--cpu runs the same code on the CPU, as a check)", file=sys.stderr)
        return 2
    names = [v.name for v in (*VARIANTS, *COMPILED) if not given.only or any(text in v.name for text in given.only)]
    if not names:
        print(f"--only {' '.join(given.only)}: no variant has such a name", file=sys.stderr)
        return 2
    if given.json is not None and not given.json.parent.is_dir():
        print(f"--json {given.json}: no such folder", file=sys.stderr)
        return 2
    if given.cpu:
        torch.set_num_threads(1)
    device = torch.device("cpu" if given.cpu else "cuda")
    networks = ("compact",) if given.cpu else (given.network,) if given.network else ("full", "compact")
    return run(Settings(device, networks, tuple(names), given.seconds, given.json, given.here))


if __name__ == "__main__":
    sys.exit(main())

"""`gcs bench` and `gcs bench track`."""

from __future__ import annotations

import argparse
from pathlib import Path

from gcs.errors import ConfigError


def speed(args: argparse.Namespace) -> int:
    """What each stage costs on this machine."""
    from gcs.bench import run

    run(print, as_json=args.json)
    return 0


def track(args: argparse.Namespace) -> int:
    """Success and precision on a folder of sequences."""
    from tracker.eval.run import bench

    dataset = Path(args.dataset)
    if not dataset.is_dir():
        raise ConfigError(f"{dataset}: no such folder of sequences")
    results = None if args.results is None else Path(args.results)
    bench(dataset, args.weights, print, as_json=args.json, results=results)
    return 0

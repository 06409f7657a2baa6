"""`gcs replay`: shown again, or flown again; only the second imports what flies."""

from __future__ import annotations

import argparse
import importlib

from gcs.errors import GcsError


def main(args: argparse.Namespace) -> int:
    """The command."""
    fly_again = args.verify or args.with_config is not None
    if args.from_stage is not None and not fly_again:
        raise GcsError("--from: only with --verify or --with")
    module = importlib.import_module("gcs.verify.command" if fly_again else "gcs.replay.play")
    return int(module.main(args))

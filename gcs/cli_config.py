"""`gcs config`."""

from __future__ import annotations

import argparse

from gcs.config import load
from gcs.config_example import render


def main(args: argparse.Namespace) -> int:
    """Print the example, or check a file."""
    if args.file is None:
        print(render(), end="")
        return 0
    load(args.file)
    print(f"{args.file}: good")
    return 0

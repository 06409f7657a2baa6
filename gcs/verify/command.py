"""`gcs replay FLIGHT --verify` and `--with CONFIG`: a recorded flight flown again. Nothing is sent anywhere."""

from __future__ import annotations

import argparse
import logging
import sys
from pathlib import Path

from gcs.config import Config
from gcs.errors import EXIT_FAULT, printable
from gcs.json_line import json_line
from gcs.operator.terminal_screen import Screen
from gcs.recorder.flights import find_flight
from gcs.verify.tuning import WhatIf, compare_with
from gcs.verify.verify import Start, Verdict, verify


def main(args: argparse.Namespace) -> int:
    """The command; 1 where the flight does not come out as it was recorded."""
    screen = Screen(sys.stderr if args.json else sys.stdout)
    folder = find_flight(args.flight, Path(Config().recorder.folder))
    start = None if args.from_stage is None else Start(args.from_stage)
    logger = logging.getLogger("gcs")
    level = logger.level
    logger.setLevel(logging.ERROR)  # warnings of then are no news now
    try:
        outcome: Verdict | WhatIf
        if args.with_config is not None:
            outcome = compare_with(folder, Path(args.with_config), start, screen.live)
        else:
            outcome = verify(folder, start or Start.TRACKER, screen.live)
    finally:
        logger.setLevel(level)
        screen.end()
    if args.json:
        sys.stdout.write(json_line(outcome))
    else:
        for line in outcome.lines():
            screen.say(printable(line))
    return EXIT_FAULT if isinstance(outcome, Verdict) and not outcome.equal else 0

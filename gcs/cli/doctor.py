"""`gcs doctor`: arguments to a question, progress while it works, the table and the verdict."""

from __future__ import annotations

import argparse
import json
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.table import Table
from rich.text import Text

from gcs.cli.args_vehicle import with_arguments
from gcs.config import Config, load_with_origins
from gcs.config_yaml import Layered
from gcs.doctor.check import Level, Question, Result, fail, ok
from gcs.doctor.diagnose import diagnose
from gcs.errors import EXIT_FAULT, ConfigError, GcsError
from gcs.profiles import profile_path

_STYLES: Final = {Level.OK: "green", Level.WARN: "yellow", Level.FAIL: "bold red", Level.SKIP: "dim"}
_WIDEST: Final = 110


def main(args: argparse.Namespace) -> int:
    """0: nothing fails. 1: something does."""
    if not (math.isfinite(args.seconds) and 1.0 <= args.seconds <= 60.0):
        raise GcsError(f"--seconds {args.seconds:g}: must be from 1 to 60")
    results: list[Result] = []
    progress = Console(stderr=True)
    with progress.status("") as status:
        for result in _results(args, lambda text: status.update(Text(text, style="dim"))):
            results.append(result)
            if args.json:
                print(json.dumps(result.as_json()), flush=True)
    failed = any(result.level is Level.FAIL for result in results)
    if args.json:
        counts = Counter(result.level.value for result in results)
        print(json.dumps({"passed": not failed, **{level.value: counts[level.value] for level in Level}}))
    else:
        show(results)
    return EXIT_FAULT if failed else 0


def _results(args: argparse.Namespace, say: Callable[[str], None]) -> Iterator[Result]:
    written, result = _configuration(args)
    yield result
    yield from diagnose(_question(args, written), say)


def _configuration(args: argparse.Namespace) -> tuple[Layered[Config], Result]:
    """What is to be checked goes on with the profile alone where the file is no good."""
    if args.profile is not None:
        profile_path(args.profile)  # an unknown name is misuse
    try:
        written = load_with_origins(args.config, args.profile)
    except ConfigError as error:
        fix = "put that right; `gcs config --explain KEY` shows what a key may be"
        return load_with_origins(None, args.profile), fail("configuration", str(error), fix)
    names = [name for name in (args.config, args.profile and f"profile {args.profile}") if name]
    text = f"{' over '.join(names)}: {len(written.origins)} values set" if names else "the defaults"
    return written, ok("configuration", text)


def _question(args: argparse.Namespace, written: Layered[Config]) -> Question:
    config = written.value
    config = replace(config, vehicle=with_arguments(config.vehicle, args))
    vehicle_is_named = args.vehicle is not None or "vehicle.url" in written.origins
    source = Path(__file__).parents[2]
    return Question(
        config=config,
        video=args.video or config.video.url,
        vehicle=config.vehicle.url if vehicle_is_named else None,
        watch_s=args.seconds,
        quick=args.quick,
        source=source if (source / "constraints.txt").is_file() else None,
    )


def show(results: Sequence[Result]) -> None:
    """The table, and the verdict below it."""
    console = Console(highlight=False)
    console = Console(highlight=False, width=min(console.width, _WIDEST))
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for result in results:
        text = Text(result.text, style="dim" if result.level is Level.SKIP else "")
        if result.fix:
            text.append(f"\nfix: {result.fix}", style="bold")
        table.add_row(Text(result.level.value, style=_STYLES[result.level]), result.name, text)
    console.print(table)
    counts = Counter(result.level for result in results)
    console.print(Text(verdict(counts[Level.FAIL], counts[Level.WARN]), style="bold"))


def verdict(fails: int, warnings: int) -> str:
    """The last line."""
    if fails:
        return f"{fails} to fix before a flight, {warnings} to think about."
    return f"Nothing to fix, {warnings} to think about." if warnings else "All fine."

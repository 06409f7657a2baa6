"""`gcs bench`: arguments in; table, JSON and picture out."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from gcs.benchmark import reference
from gcs.benchmark.plot import plot
from gcs.benchmark.report import markdown
from gcs.benchmark.results import Results
from gcs.benchmark.run import QUICK, Counts, Options, run
from gcs.errors import ConfigError


def main(args: argparse.Namespace, say: Callable[[str], None], tell: Callable[[str], None]) -> int:
    """Measure, compare with the reference, keep it. say: the result; tell: all else."""
    out = Path(args.out)
    out.mkdir(parents=True, exist_ok=True)
    known = reference.load()  # refused before minutes have passed
    if args.update_reference and args.quick:
        raise ConfigError("--update-reference with --quick: a reference is worth its minutes")
    options = Options(
        cache=out / "cache",
        only=tuple(args.only or ()),
        counts=QUICK if args.quick else Counts(),
        nano=None if args.nano is None else (Path(args.nano[0]), Path(args.nano[1])),
        vit=None if args.vit is None else Path(args.vit),
        contrib=not args.no_contrib,
    )
    results = run(options)
    if known is not None:
        results = replace(results, changes=reference.changes(results.ratios(), known))
    keep(results, out)
    say(json.dumps(results.as_json()) if args.json else markdown(results).rstrip())
    if args.update_reference:
        reference.update(results.machine.facts, results.ratios())
        tell(f"written: {reference.FILE}")
    return 0


def keep(results: Results, out: Path) -> None:
    """table.md, bench.json and plot.png in this folder."""
    (out / "table.md").write_text(markdown(results), encoding="utf-8")
    (out / "bench.json").write_text(json.dumps(results.as_json(), indent=1) + "\n", encoding="utf-8")
    plot(out / "plot.png", results)

"""`gcs scenarios`: closed-loop flights in simulated time, and the table they make."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.errors import ConfigError

if TYPE_CHECKING:
    from gcs.scenarios.catalogue import Case
    from gcs.scenarios.chance import Verdict
    from gcs.scenarios.conditions import LawKind
    from gcs.scenarios.table import Line

_MOST = 100_000


def main(args: argparse.Namespace) -> int:
    """0 where nothing is worse than the reference, nothing unsafe, nothing too near."""
    jobs = _count(args.jobs, os.cpu_count() or 1, "--jobs", 256)
    if args.random is not None or args.occlusions is not None:
        return _by_lot(args, jobs)
    from gcs.scenarios.sweep import fly_table

    cases = _chosen(args)
    seeds = _count(args.seeds, 3 if args.all or args.update_reference else 1, "--seeds", _MOST)
    out = Path(args.out) if args.out else None
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    lines = fly_table(cases, _laws(whole=args.all or bool(args.only)), seeds, jobs, out, _say)
    return _conclude(args, lines, out)


def _chosen(args: argparse.Namespace) -> Sequence[Case]:
    from gcs.scenarios.catalogue import cases, find
    from gcs.scenarios.sweep import with_real_tracker

    names = [find(name).name for name in args.only]
    found = list(cases())
    if names:
        found = [case for name in names for case in _rows(name, whole=args.all)]
    elif not args.all:
        found = [case for case in found if case.quick]
    if args.tracker == "real":
        found = with_real_tracker(found)
    if not found:
        raise ConfigError("--tracker real: none of these can be painted")
    return found


def _rows(name: str, *, whole: bool) -> Sequence[Case]:
    """Of one scenario: all, or the quick ones, or where there is none the first."""
    from gcs.scenarios.catalogue import cases

    rows = [case for case in cases() if case.scenario.name == name]
    return rows if whole else [case for case in rows if case.quick] or rows[:1]


def _laws(*, whole: bool) -> Callable[[Case], Iterable[LawKind]]:
    """Which laws fly a case: the naive one everywhere, or where the figures to reach are stated."""
    from control.modes import FollowMode
    from gcs.scenarios.conditions import LawKind

    def laws(case: Case) -> Iterable[LawKind]:
        stated = case.scenario.name in ("sine", "zigzag") and case.mode is FollowMode.SPOTLIGHT
        both = stated or (whole and not case.conditions.gimbal)  # a gimbal is not steered by the law
        return tuple(LawKind) if both else (LawKind.STATION,)

    return laws


def _conclude(args: argparse.Namespace, lines: Sequence[Line], out: Path | None) -> int:
    from gcs.scenarios import reference
    from gcs.scenarios.conditions import LawKind
    from gcs.scenarios.table import as_json, markdown

    for line in lines if args.json else ():
        print(json.dumps(as_json(line)))
    if not args.json:
        print(markdown(lines), end="")
    if out is not None:
        (out / "scenarios.md").write_text(markdown(lines), encoding="utf-8")
        (out / "scenarios.json").write_text(json.dumps([as_json(line) for line in lines], indent=1), encoding="utf-8")
    problems = [problem for line in lines if line.law is LawKind.STATION for problem in line.problems]
    if args.update_reference:
        reference.update(lines)
        _say(f"written: {reference.FILE}")
    else:
        known = reference.load()
        problems += [f"worse than the reference: {text}" for text in reference.worse(lines, known)]
        missing = reference.unknown(lines, known)
        if missing:
            _say(f"not in the reference: {', '.join(missing)}")
    for problem in problems:
        _say(problem)
    return 1 if problems else 0


def _by_lot(args: argparse.Namespace, jobs: int) -> int:
    from gcs.scenarios.chance import occlusions, random_flights

    verdicts: list[Verdict] = []
    if args.random is not None:
        verdicts.append(random_flights(_count(args.random, 0, "--random", _MOST), jobs, _say, args.first_seed))
    if args.occlusions is not None:
        verdicts.append(occlusions(_count(args.occlusions, 0, "--occlusions", _MOST), jobs, _say, args.first_seed))
    for verdict in verdicts:
        print(verdict.text)
    return 0 if all(verdict.passed for verdict in verdicts) else 1


def _count(value: int | None, default: int, name: str, most: int) -> int:
    if value is None:
        return default
    if not 1 <= value <= most:
        raise ConfigError(f"{name} {value}: must be from 1 to {most}")
    return value


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)

"""Many flights on several processes, and the table they make."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from gcs.scenarios.catalogue import Case
from gcs.scenarios.conditions import LawKind, TrackerKind
from gcs.scenarios.measure import Row
from gcs.scenarios.plots import plot
from gcs.scenarios.run import fly_and_keep
from gcs.scenarios.table import Line, line_of

_A = TypeVar("_A")
_B = TypeVar("_B")
Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Job:
    """One flight. plot: where its picture goes."""

    case: Case
    law: LawKind
    seed: int
    plot: Path | None = None

    @property
    def label(self) -> str:
        """Case, law and seed."""
        law = "" if self.law is LawKind.STATION else f" {self.law.value}"
        return f"{self.case.label}{law}, seed {self.seed}"


def in_processes(work: Callable[[_A], _B], what: Sequence[_A], jobs: int) -> Iterator[_B]:
    """In the order given; with one job, here."""
    if jobs == 1 or len(what) < 2:
        yield from map(work, what)
        return
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    with ProcessPoolExecutor(min(jobs, len(what)), multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(work, what)


def fly_job(job: Job) -> Row:
    """One flight, and its picture."""
    conditions = replace(job.case.conditions, seed=job.seed, law=job.law)
    flown = fly_and_keep(job.case.scenario, conditions)
    assert flown.row is not None
    if job.plot is not None and flown.samples:
        plot(job.plot, flown.samples, flown.row, f"{job.case.scenario.name}: {job.case.scenario.text} ({job.label})")
    return flown.row


def fly_table(
    cases: Sequence[Case], laws: Callable[[Case], Iterable[LawKind]], seeds: int, jobs: int, out: Path | None, say: Say
) -> list[Line]:
    """Every case with its laws and seeds. say: gets a line for each flight that has ended."""
    work = [
        Job(case, law, seed, _picture(out, case, law) if seed == 1 else None)
        for case in cases
        for law in laws(case)
        for seed in range(1, seeds + 1)
    ]
    rows: dict[tuple[str, LawKind], list[Row]] = {}
    for number, (job, row) in enumerate(zip(work, in_processes(fly_job, work, jobs), strict=True), 1):
        rows.setdefault((job.case.label, job.law), []).append(row)
        say(f"{number}/{len(work)} {job.label}: {row.refusal or _summary(row)}")
    return [line_of(case, law, rows[case.label, law]) for case in cases for law in laws(case)]


def _picture(out: Path | None, case: Case, law: LawKind) -> Path | None:
    if out is None:
        return None
    name = case.label.replace(" ", "_").replace("%", "pct")
    return out / f"{name}{'' if law is LawKind.STATION else '_' + law.value}.png"


def _summary(row: Row) -> str:
    words = [f"{row.bearing_rms_deg:.2f} deg", f"{100 * row.on_target_frac:.0f} % on target", row.state.value]
    return ", ".join([*words, *row.causes])


def with_real_tracker(cases: Iterable[Case]) -> list[Case]:
    """The same on painted pictures; without those in which the target is hidden by nothing that could be painted."""
    plain = [case for case in cases if not case.scenario.covered and not case.note]
    return [
        replace(case, conditions=replace(case.conditions, tracker=TrackerKind.REAL))
        for case in plain
        if case.conditions.delay_s == 0.1 and case.conditions.fps == 20.0
    ]

"""Runs of the hazard table on several processes, and what they come to."""

from __future__ import annotations

import itertools
import logging
import multiprocessing
import random
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from tqdm import tqdm

from tests.faults.hazards import FAULTS
from tests.faults.pairs import fly_pair
from tests.faults.script import Expect, Fault, Outcome, Phase, fly

Job = tuple[int, int, int, int]  # fault, second fault or -1, phase, seed


@dataclass(slots=True)
class Row:
    """One line of the table."""

    label: str
    expect: str
    bound_s: float | None
    runs: int = 0
    unsafe: int = 0
    failed: int = 0
    worst_s: float | None = None
    went_on: int = 0
    could_go_on: int = 0
    examples: list[str] = field(default_factory=list)

    def add(self, outcome: Outcome, goes_on: bool) -> None:
        """One more run."""
        self.runs += 1
        self.unsafe += outcome.unsafe > 0
        self.failed += bool(outcome.problems)
        if outcome.last_moving_s is not None:
            self.worst_s = max(self.worst_s or 0.0, outcome.last_moving_s)
        if goes_on and outcome.phase is not Phase.LOST:
            self.could_go_on += 1
            self.went_on += outcome.went_on
        if outcome.problems and len(self.examples) < 5:
            self.examples.append(f"{outcome.phase.value}, seed {outcome.seed}: {'; '.join(outcome.problems[:3])}")


def singles(faults: Sequence[Fault], phases: Iterable[Phase], seeds: Iterable[int]) -> list[Job]:
    """Every fault in each of its phases with every seed."""
    wanted, numbers = tuple(phases), tuple(seeds)
    return [
        (FAULTS.index(fault), -1, list(Phase).index(phase), seed)
        for fault, phase, seed in itertools.product(faults, wanted, numbers)
        if phase in fault.phases
    ]


def all_pairs(faults: Sequence[Fault]) -> list[Job]:
    """Every two faults of different hazards once; phase and seed go round."""
    pairs = [(a, b) for a, b in itertools.combinations(faults, 2) if a.hazard != b.hazard]
    return [
        (FAULTS.index(a), FAULTS.index(b), number % len(Phase), number // len(Phase) % 20)
        for number, (a, b) in enumerate(pairs)
    ]


def run_job(job: Job) -> tuple[Job, Outcome]:
    """One run; a run that raises is a failed one."""
    first, second, phase_number, seed = job
    fault, phase = FAULTS[first], list(Phase)[phase_number]
    disabled = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        outcome = fly(fault, phase, seed) if second < 0 else fly_pair(fault, FAULTS[second], phase, seed)
    except Exception as error:  # noqa: BLE001 - the campaign goes on and reports it
        outcome = Outcome(fault.label, phase, seed, None, False, 0, (f"the run raised {error!r}",), 0, 0.0)
    finally:
        logging.disable(disabled)
    return job, outcome


def run_all(jobs: Sequence[Job], processes: int) -> Iterator[tuple[Job, Outcome]]:
    """All of them, in any order, with a progress bar and what goes wrong at once."""
    for job, outcome in _results(random.Random(0).sample(jobs, len(jobs)), processes):
        if outcome.problems:
            tqdm.write(
                f"{outcome.label}, {outcome.phase.value}, seed {outcome.seed}: {'; '.join(outcome.problems[:2])}"
            )
        yield job, outcome


def _results(jobs: Sequence[Job], processes: int) -> Iterator[tuple[Job, Outcome]]:
    if processes <= 1:
        yield from tqdm(map(run_job, jobs), total=len(jobs), unit="run", smoothing=0.05)
        return
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        yield from tqdm(pool.imap_unordered(run_job, jobs, chunksize=4), total=len(jobs), unit="run", smoothing=0.05)


def table(results: Iterable[tuple[Job, Outcome]]) -> list[Row]:
    """One row for each fault, one for all pairs."""
    rows: dict[int, Row] = {}
    for (first, second, _, _), outcome in results:
        key = first if second < 0 else len(FAULTS)
        if key not in rows:
            fault = FAULTS[first]
            rows[key] = (
                Row(fault.label, fault.expect.value, fault.bound_s) if second < 0 else Row("all pairs", "safe", None)
            )
        rows[key].add(outcome, second < 0 and FAULTS[first].expect in (Expect.GOES_ON, Expect.SAFE))
    return [rows[key] for key in sorted(rows)]


def markdown(rows: Sequence[Row]) -> str:
    """The table as it stands in a report."""
    lines = [
        "| fault | must end | bound s | worst s | runs | unsafe | failed | went on |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in rows:
        bound = "" if row.bound_s is None else f"{row.bound_s:.2f}"
        worst = "" if row.worst_s is None or row.bound_s is None else f"{row.worst_s:.3f}"
        on = f"{row.went_on / row.could_go_on:.0%}" if row.could_go_on else ""
        lines.append(
            f"| {row.label} | {row.expect} | {bound} | {worst} | {row.runs} | {row.unsafe} | {row.failed} | {on} |"
        )
    return "\n".join(lines) + "\n"

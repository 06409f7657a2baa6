"""A whole benchmark: every sequence run or read, kept as it is finished, in the data set's order at the end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from tqdm import tqdm

from tracker.eval.cluster import run_cluster
from tracker.eval.datasets import Broken, Dataset
from tracker.eval.parallel import Report, Sequences, run_here, run_processes
from tracker.eval.run import Job, Outcome
from tracker.eval.store import Store


@dataclass(frozen=True, slots=True)
class Results:
    """One tracker's outcomes in the data set's order, and what could not be scored."""

    tracker: str
    outcomes: tuple[Outcome, ...]
    broken: tuple[Broken, ...] = ()


def run_benchmark(
    name: str,
    job: Job,
    dataset: Dataset,
    say: Callable[[Outcome], object],
    *,
    store: Store | None = None,
    jobs: int = 1,
    cluster: str | None = None,
) -> Results:
    """Track every sequence that the store has not; `say` each outcome when it is there.

    jobs: processes; cluster: address of a Dask scheduler, instead of processes here.
    """
    done: dict[str, Outcome] = {}
    broken = list(dataset.broken)
    for sequence in dataset.sequences:
        earlier = store.finished(sequence) if store is not None else None
        if earlier is not None:
            done[earlier.name] = earlier
            say(earlier)
    left = tuple(s for s in dataset.sequences if s.name not in done)
    with tqdm(total=sum(map(len, left)), unit="frame", leave=False, disable=not left) as bar:
        for outcome in _run(job, left, jobs, cluster, bar.update):
            if isinstance(outcome, Broken):
                broken.append(outcome)
                continue
            if store is not None:
                store.add(outcome)
            done[outcome.name] = outcome
            say(outcome)
    ordered = tuple(done[s.name] for s in dataset.sequences if s.name in done)
    return Results(name, ordered, tuple(broken))


def _run(job: Job, sequences: Sequences, jobs: int, cluster: str | None, done: Report) -> Iterator[Outcome | Broken]:
    if not sequences:
        return iter(())
    if cluster is not None:
        return run_cluster(job, sequences, cluster, done)
    return run_here(job, sequences, done) if jobs == 1 else run_processes(job, sequences, jobs, done)

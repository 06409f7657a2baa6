"""Many sequences: in this process, in several, or on a cluster; outcomes as they are finished."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool

import cv2

from tracker.eval.datasets import Broken
from tracker.eval.run import Job, Outcome
from tracker.eval.sequences import Sequence

Sequences = tuple[Sequence, ...]
Report = Callable[[int], object]  # of so many frames done


def attempt(job: Job, sequence: Sequence, on_frame: Callable[[], object] | None = None) -> Outcome | Broken:
    """One sequence; bad input becomes a line, so that the others go on."""
    try:
        return job.run(sequence, on_frame)
    except (ValueError, OSError, cv2.error) as error:
        text = " ".join(str(error).split())
        return Broken(sequence.name, text if sequence.name in text else f"{sequence.name}: {text}")


def run_here(job: Job, sequences: Sequences, done: Report) -> Iterator[Outcome | Broken]:
    """One after the other, in their order."""
    for sequence in sequences:
        yield attempt(job, sequence, lambda: done(1))


def run_processes(job: Job, sequences: Sequences, jobs: int, done: Report) -> Iterator[Outcome | Broken]:
    """In so many processes, the longest first: they end at about the same time. Stopped early, all are ended."""
    context = multiprocessing.get_context("spawn")  # PyTorch's threads do not survive a fork
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(min(jobs, len(sequences)), context, initializer=_die_on_interrupt)
    is_done = False
    try:
        waiting = {pool.submit(attempt, job, sequence): sequence for sequence in longest_first(sequences)}
        for future in as_completed(waiting):
            sequence = waiting[future]
            try:
                yield future.result()
            except BrokenProcessPool:
                yield Broken(sequence.name, f"{sequence.name}: its process died (out of memory?)")
            done(len(sequence))
        is_done = True
    finally:
        if not is_done:
            for process in set(multiprocessing.active_children()) - before:
                process.terminate()
        pool.shutdown(cancel_futures=True)


def longest_first(sequences: Sequences) -> list[Sequence]:
    """In the order in which work is handed out."""
    return sorted(sequences, key=len, reverse=True)


def _die_on_interrupt() -> None:
    """A terminal's Ctrl-C reaches every process: the workers end without a word."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)

"""Whole benchmarks on several machines, through Dask (`dask scheduler`, `dask worker`; the extra `cluster`)."""

from __future__ import annotations

from collections.abc import Iterator

from tracker.eval.datasets import Broken
from tracker.eval.parallel import Report, Sequences, attempt, longest_first
from tracker.eval.run import Job, Outcome

CONNECT_S = 10.0


class ClusterError(ValueError):
    """The cluster cannot be used; one line that says why."""


def run_cluster(job: Job, sequences: Sequences, address: str, done: Report) -> Iterator[Outcome | Broken]:
    """On the workers of the scheduler at an address (tcp://HOST:8786), the longest first.

    Every worker needs this package, and data set and weights at the same paths. Stopped early, the rest is cancelled.
    """
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise ClusterError("a cluster needs the extra: pip install 'climrt-gcs[cluster]'") from None
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:  # TimeoutError is an OSError
        raise ClusterError(f"{address}: no Dask scheduler answers there ({error})") from None
    try:
        if not client.scheduler_info()["workers"]:
            raise ClusterError(f"{address}: the scheduler has no workers")
        # pure=False: the same weights path may hold other weights than in an earlier run.
        waiting = {client.submit(attempt, job, s, pure=False): s for s in longest_first(sequences)}
        try:
            for future in as_completed(waiting, loop=client.loop):
                fault, name = future.exception(), waiting[future].name
                yield future.result() if fault is None else Broken(name, f"{name}: {type(fault).__name__}: {fault}")
                done(len(waiting[future]))
        finally:
            client.cancel(list(waiting))
    finally:
        client.close()

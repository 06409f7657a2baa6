"""Times of calls that take turns, so that a busy machine is busy for all of them alike."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

import cv2
import numpy as np

from gcs.errors import GcsError

_SAMPLE_S: Final = 2e-3  # a shorter call is repeated: the clock and the loop must not count
_MOST_CALLS: Final = 500


class BenchError(GcsError):
    """Something cannot be measured here; one line."""


class Sample(NamedTuple):
    """One call. cpu_ms: of all threads of the process together."""

    cpu_ms: float
    wall_ms: float


class Case(Protocol):
    """Something that is measured in turns with others."""

    @property
    def name(self) -> str:
        """Unique in its group."""
        ...

    @property
    def threads(self) -> int:
        """It may use so many."""
        ...

    @property
    def uneven(self) -> bool:
        """Not every call does the same work: the mean tells what it costs, not the median."""
        ...

    def turn(self) -> list[Sample]:
        """Some calls. Raises BenchError where it cannot go on."""
        ...


@dataclass(frozen=True, slots=True)
class Figure:
    """What a case came to: medians, 90th percentiles, means and least, ms. uneven: see Case."""

    name: str
    threads: int
    cpu_ms: float
    cpu_p90_ms: float
    cpu_mean_ms: float
    cpu_least_ms: float
    wall_ms: float
    wall_p90_ms: float
    wall_mean_ms: float
    wall_least_ms: float
    samples: int
    uneven: bool = False

    @classmethod
    def of(cls, case: Case, samples: Sequence[Sample]) -> Figure:
        """samples: at least one."""
        cpu, wall = (np.array(values) for values in zip(*samples, strict=True))
        return cls(
            case.name, case.threads,
            float(np.median(cpu)), float(np.percentile(cpu, 90)), float(cpu.mean()), float(cpu.min()),
            float(np.median(wall)), float(np.percentile(wall, 90)), float(wall.mean()), float(wall.min()),
            len(samples), case.uneven,
        )  # fmt: skip

    @property
    def cost_ms(self) -> float:
        """CPU time of one call: what ratios are made of."""
        return self.cpu_mean_ms if self.uneven else self.cpu_ms

    @property
    def wall_cost_ms(self) -> float:
        """The same on the wall's clock: what rates are made of."""
        return self.wall_mean_ms if self.uneven else self.wall_ms


class Repeated:
    """A call that does the same each time; a short one is repeated within each sample."""

    uneven = False

    def __init__(self, name: str, call: Callable[[], object], *, threads: int = 1, samples: int = 5) -> None:
        self.name, self.threads = name, threads
        self._call, self._samples = call, samples
        self._calls = 0  # in a sample; 0: not known yet

    def turn(self) -> list[Sample]:
        """See Case."""
        use_threads(self.threads)
        warm = timed(self._call)
        if not self._calls:  # the very first call loads and compiles
            warm = timed(self._call)
            self._calls = min(_MOST_CALLS, max(1, math.ceil(_SAMPLE_S * 1e3 / max(warm.wall_ms, 1e-6))))
        return [timed(self._call, self._calls) for _ in range(self._samples)]


def timed(call: Callable[[], object], calls: int = 1) -> Sample:
    """One sample: the mean of so many calls."""
    cpu_s, wall_s = time.process_time(), time.perf_counter()
    for _ in range(calls):
        call()
    return Sample((time.process_time() - cpu_s) * 1e3 / calls, (time.perf_counter() - wall_s) * 1e3 / calls)


def use_threads(threads: int) -> None:
    """So many for PyTorch and for OpenCV, in the whole process."""
    import torch  # seconds: not for who only takes a time

    if torch.get_num_threads() != threads:
        torch.set_num_threads(threads)
    cv2.setNumThreads(threads)


def in_turns(
    cases: Iterable[Case], rounds: int, ticked: Callable[[str], None], note: Callable[[str], None]
) -> dict[Case, Figure]:
    """All cases one after the other, so many times over. ticked: told of each turn; note: why a case is left out."""
    found: dict[Case, list[Sample]] = {case: [] for case in cases}
    broken: set[Case] = set()
    for _ in range(rounds):
        for case, samples in found.items():
            if case in broken:
                continue
            ticked(case.name)
            try:
                samples += case.turn()
            except BenchError as error:
                broken.add(case)
                note(f"{case.name}: {error}")
    return {case: Figure.of(case, samples) for case, samples in found.items() if samples and case not in broken}


def measure(call: Callable[[], object], runs: int) -> Figure:
    """So many calls by themselves, after one to warm up; threads as they are."""
    timed(call)
    return Figure.of(Repeated("", call), [timed(call) for _ in range(runs)])


def ratios(figures: Iterable[Figure], reference: Figure) -> dict[str, float]:
    """CPU time of each by its name, in units of the reference's."""
    return {figure.name: figure.cost_ms / reference.cost_ms for figure in figures if figure is not reference}

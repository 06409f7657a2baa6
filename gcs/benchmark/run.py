"""One run of everything, or of some groups, with a line that says how far it is."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from tqdm import tqdm

from gcs.benchmark import age, contrib, growth, machine, memory, roofline, stages_station, stages_tracker, trackers
from gcs.benchmark.age_world import CAMERAS
from gcs.benchmark.films import Film, resized, sample
from gcs.benchmark.results import Group, Results
from gcs.benchmark.timing import BenchError, Case, Figure, in_turns
from gcs.cli.args_measure import BENCH_GROUPS

_HD: Final = (1280, 720)


@dataclass(frozen=True, slots=True)
class Counts:
    """How much of each; film: pictures of the sample."""

    rounds: int = 5
    film: int | None = None
    threads: tuple[int, ...] = (1, 2)
    age_s: float = 20.0
    quick: bool = False


QUICK: Final = Counts(rounds=2, film=30, threads=(1,), age_s=6.0, quick=True)


@dataclass(frozen=True, slots=True)
class Options:
    """only: groups, empty for all. nano: backbone and head. contrib: with trackers of another environment.

    cache: folder for that environment, which is made once.
    """

    cache: Path
    only: Collection[str] = ()
    counts: Counts = Counts()
    nano: tuple[Path, Path] | None = None
    vit: Path | None = None
    contrib: bool = True


def run(options: Options) -> Results:
    """Measure. What cannot be is a line in the notes; the rest goes on."""
    results = Results()
    results.machine.facts = machine.describe()
    before = os.getloadavg()[0]
    wanted = [name for name in BENCH_GROUPS if name in options.only or not options.only]
    film = sample(options.counts.film)
    with (
        tempfile.TemporaryDirectory() as folder,
        tqdm(total=0, desc="bench", unit=" turns", leave=False, disable=None) as bar,
    ):
        bench = _Bench(options, film, Path(folder), results, bar)
        for name in wanted:
            group_s = time.monotonic()
            getattr(bench, name)()
            results.seconds[name] = time.monotonic() - group_s
    results.machine.load = (before, os.getloadavg()[0])
    return results


class _Bench:
    """A method for each of BENCH_GROUPS."""

    def __init__(self, options: Options, film: Film, folder: Path, results: Results, bar: tqdm) -> None:
        self._options, self._counts = options, options.counts
        self._film, self._folder, self._results, self._bar = film, folder, results, bar

    def _ticked(self, name: str) -> None:
        self._bar.set_postfix_str(name)
        self._bar.update()

    def _note(self, text: str) -> None:
        self._results.notes.append(text)

    def _in_turns(self, groups: dict[str, list[Case]], rounds: int) -> list[Group]:
        """All of them together, with the reference tracker as one more."""
        found = trackers.reference(self._film)
        cases = [found, *(case for group in groups.values() for case in group)]
        self._bar.reset(total=rounds * len(cases))
        figures = in_turns(cases, rounds, self._ticked, self._note)
        if found not in figures:
            raise BenchError("the compact tracker cannot be measured, and nothing can be compared with it")
        reference = figures[found]
        made = [
            Group(title, [figures[case] for case in group if case in figures], reference)
            for title, group in groups.items()
        ]
        made[0].figures.insert(0, reference)
        return made

    def trackers(self) -> None:
        """Every tracker over the same pictures."""
        quick = self._counts.quick
        films = [self._film] if quick else [self._film, resized(self._film, *_HD)]
        with ExitStack() as opened:
            groups: dict[str, list[Case]] = {}
            for film in films:
                contributed = self._contributed(film, opened)
                for threads in self._counts.threads if film is self._film else (1,):
                    groups[_title(film, threads)] = [
                        *self._ours(film, threads),
                        *trackers.of_opencv(film, threads, self._options.nano, self._options.vit, self._note),
                        *contributed(threads),
                    ]
            self._results.trackers = self._in_turns(groups, self._counts.rounds)

    def _ours(self, film: Film, threads: int) -> Iterable[Case]:
        """At one thread on the sample the reference stands for the first."""
        is_plain = film is self._film
        for case in trackers.ours(film, threads, quick=self._counts.quick or not is_plain):
            if not (is_plain and threads == 1 and case.name == trackers.REFERENCE):
                yield case
        if is_plain and not self._counts.quick:
            yield trackers.paper(film, threads)

    def _contributed(self, film: Film, opened: ExitStack) -> Callable[[int], Sequence[Case]]:
        if not self._options.contrib:
            return lambda threads: ()
        try:
            python = contrib.environment(self._options.cache, self._ticked)
            return opened.enter_context(contrib.contributed(python, film, self._folder))
        except BenchError as error:
            self._note(f"CSRT and KCF: {error}")
            self._options = replace(self._options, contrib=False)  # it would be the same for the next film
            return lambda threads: ()

    def stages(self) -> None:
        """Parts of the tracker and of the station, and beside them what the machine can do at best."""
        quick, counts = self._counts.quick, self._counts.threads
        ceilings = dict(machine.cases(counts))
        groups = {
            "stages of the tracker": list(stages_tracker.cases(self._note, quick=quick)),
            "stages of the station": list(stages_station.cases(self._note, quick=quick)),
            "machine": list(ceilings),
        }
        *self._results.stages, ceiling = self._in_turns(groups, self._counts.rounds)
        del self._results.stages[0].figures[0]  # the reference is a tracker, not a stage
        self._rate(ceiling.figures, {case.name: work for case, work in ceilings.items()}, counts)

    def _rate(self, figures: list[Figure], work: dict[str, float], threads: tuple[int, ...]) -> None:
        found = self._results.machine
        found.rates = machine.rates(figures, work)
        found.peak_gflops = {count: machine.peak_gflops(found.rates, count) for count in threads}
        found.bandwidth_gbps = machine.bandwidth_gbps(found.rates)
        self._results.roofline = roofline.points(
            self._results.stages[0].figures, found.peak_gflops[1], found.bandwidth_gbps
        )

    def age(self) -> None:
        """Whole stations."""
        self._bar.reset(total=1 if self._counts.quick else len(age.SIZES) * len(CAMERAS))
        self._results.ages = age.all_ages(
            self._counts.age_s, self._folder, self._ticked, self._note, quick=self._counts.quick
        )

    def growth(self) -> None:
        """With the size of the picture."""
        cases = list(growth.cases(self._film, self._note, quick=self._counts.quick))
        groups = self._in_turns({"size of the picture": cases}, max(1, self._counts.rounds // 2))
        del groups[0].figures[0]
        self._results.growth_cases, self._results.growth = groups, growth.sizes(groups[0].figures)

    def memory(self) -> None:
        """Of processes of their own."""
        self._bar.reset(total=4)
        self._results.memory_mib = memory.measure(self._folder, self._ticked, self._note, quick=self._counts.quick)


def _title(film: Film, threads: int) -> str:
    width, height = film.size
    return f"trackers, {width}x{height}, {'1 thread' if threads == 1 else f'{threads} threads'}"

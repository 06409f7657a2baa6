"""What a run has found, as tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain

from gcs.benchmark.age import Ages
from gcs.benchmark.growth import Size
from gcs.benchmark.published import FIGURES
from gcs.benchmark.results import Group, Machine, Results
from gcs.benchmark.roofline import Point

_QUIET_LOAD = 0.5  # of the minute before
_AGE = (
    "Age of the newest picture that a setpoint was made from, from its arrival (coded) to the setpoint at the vehicle; "
    "that includes waiting for the 20 Hz tick. Answer: from arrival to the tracker's box. The parts after it are of "
    "each picture that became a setpoint; wait: for the tracker, control: from its answer to the tick. "
    "p50 / p99 in ms; the camera sends 30 a second."
)
_COUNTED = (
    "CPU time is that of all threads together. Mean and rate are over all pictures: some cost more, as every fifth "
    "(the filter learns) and every tenth (the re-detection does). x: mean CPU time in units of the first line's."
)

_BOUND = (
    "MB: what PyTorch's operations read and write one after the other; an engine that fuses moves less. Bound by what "
    "would take more than half of the time at the measured ceiling; overhead: neither does, so it is many small "
    "operations, copies between layouts, or kernels that fall short."
)
_BUSY = (
    "**Other programs were running.** CPU times and ratios of one thread hold; times on the wall's clock, ages and "
    "everything with more threads are worse than they would be alone."
)


def markdown(results: Results) -> str:
    """All that was measured."""
    return "\n".join(chain.from_iterable(_parts(results))) + "\n"


def _parts(results: Results) -> Iterator[Iterable[str]]:
    yield _head(results)
    if results.trackers:
        yield _trackers(results.trackers)
    for group in results.stages:
        yield _stages(group)
    if results.machine.rates:
        yield _machine(results.machine)
    if results.roofline:
        yield _roofline(results.roofline)
    if results.ages:
        yield _ages(results.ages)
    if results.growth:
        yield _growth(results.growth)
    if results.memory_mib:
        rows = ([name, f"{mib:.0f}"] for name, mib in results.memory_mib.items())
        yield ("", "## Memory", "", *table(["peak resident memory of a process", "MiB"], rows))
    moved = [change for change in results.changes if change.moved]
    if results.changes:
        yield ("", f"## Against the reference: {len(moved)} of {len(results.changes)} ratios moved by over 30 %", "")
        yield (f"- {change.group}: {change}" for change in moved)
    if results.notes:
        yield ("", "## Left out", "", *(f"- {note}" for note in results.notes))


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Lined up, for people too; the first column is text, the others are figures."""
    cells = [list(head), *map(list, rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(head))]
    for number, row in enumerate(cells):
        line = (c.ljust(w) if i == 0 else c.rjust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True)))
        yield f"| {' | '.join(line)} |"
        if number == 0:
            yield f"|{'|'.join('-' * (w + 1) + ('-' if i == 0 else ':') for i, w in enumerate(widths))}|"


def _head(results: Results) -> Iterator[str]:
    facts = results.machine.facts
    load = " and ".join(f"{value:.1f}" for value in results.machine.load)
    yield "# What it costs here"
    yield ""
    yield ", ".join(str(value) if name == "cpu" else f"{name} {value}" for name, value in facts.items())
    parts = ", ".join(f"{name} {seconds:.0f}" for name, seconds in results.seconds.items())
    yield f"{sum(results.seconds.values()):.0f} s in all ({parts}); load of the machine before and after: {load}"
    if results.machine.load and results.machine.load[0] > _QUIET_LOAD:
        yield from ("", _BUSY)


def _trackers(groups: Sequence[Group]) -> Iterator[str]:
    for group in groups:
        yield from ("", f"## {_title(group.title)}", "")
        head = ["", "CPU ms", "p90", "mean", "wall ms", "p90", "a second, CPU", "a second, wall", "x"]
        rows = [
            [
                figure.name, f"{figure.cpu_ms:.1f}", f"{figure.cpu_p90_ms:.1f}", f"{figure.cpu_mean_ms:.1f}",
                f"{figure.wall_ms:.1f}", f"{figure.wall_p90_ms:.1f}", f"{1e3 / figure.cost_ms:.1f}",
                f"{1e3 / figure.wall_cost_ms:.1f}", f"{figure.cost_ms / group.reference.cost_ms:.2f}",
            ]
            for figure in group.figures
        ]  # fmt: skip
        yield from table(head, rows)
    yield from ("", _COUNTED, "", "Published by others, not measured here:", "")
    yield from (f"- {each.name}: {each.figure} ({each.where})" for each in FIGURES)


def _stages(group: Group) -> Iterator[str]:
    rows = (
        [f.name, f"{f.cpu_ms:.3f}", f"{f.cpu_p90_ms:.3f}", f"{f.wall_ms:.3f}",
         f"{f.cost_ms / group.reference.cost_ms:.4f}"]
        for f in group.figures
    )  # fmt: skip
    yield from ("", f"## {_title(group.title)}, one thread, 720p", "")
    yield from table(["", "CPU ms", "p90", "wall ms", "x"], rows)


def _machine(machine: Machine) -> Iterator[str]:
    rows = ([name, f"{rate:.1f}"] for name, rate in machine.rates.items())
    yield from ("", "## Ceilings of this machine", "")
    yield from table(["", "GFLOP/s, of a copy GB/s"], rows)
    peaks = ", ".join(f"{peak:.0f} with {count} thread(s)" for count, peak in machine.peak_gflops.items())
    yield from (
        "",
        f"Measured peak, GFLOP/s: {peaks}. One thread by CPU time, more by the wall's clock; the best call.",
    )


def _roofline(points: Sequence[Point]) -> Iterator[str]:
    rows = (
        [p.stage, f"{p.gmac:.3f}", f"{p.mb:.1f}", f"{p.ms:.2f}", f"{p.gflops:.0f}", f"{p.share:.0%}", p.bound]
        for p in points
    )
    yield from ("", "## Roofline, one thread", "")
    yield from table(["", "GMAC", "MB moved", "CPU ms", "GFLOP/s", "of the peak", "bound by"], rows)
    yield from (
        "",
        "MB: what PyTorch's operations read and write one after the other; an engine that fuses moves less.",
    )


def _ages(ages: Sequence[Ages]) -> Iterator[str]:
    parts = list(ages[0].parts)
    head = ["", "setpoint's age", "most", "answer", *parts, "a second", "cores"]
    rows = (
        [
            a.name, f"{a.setpoint.p50:.0f} / {a.setpoint.p99:.0f}", f"{a.setpoint.most:.0f}",
            *(f"{spread.p50:.0f} / {spread.p99:.0f}" for spread in (a.answer, *a.parts.values())),
            f"{a.tracked_fps:.1f}", f"{a.cores:.2f}",
        ]
        for a in ages
    )  # fmt: skip
    yield from ("", "## From a picture to the setpoint, in a whole station", "")
    yield from table(head, rows)
    yield from ("", _AGE, f"Flown with: {'; '.join(sorted({a.tracker for a in ages}))}.")


def _growth(sizes: Sequence[Size]) -> Iterator[str]:
    parts = list(sizes[0].parts)
    rows = ([s.name, *(f"{s.parts[part]:.2f}" for part in parts), f"{s.total_ms:.1f}"] for s in sizes)
    yield from ("", "## A tracked, shown picture by its size, CPU ms", "")
    yield from table(["", *parts, "all"], rows)
    yield from (
        "",
        "What viewers of the page cost: `python -m tests.page_load`; recording: `python -m tests.recorder.cost`.",
    )


def _title(text: str) -> str:
    return text[0].upper() + text[1:]

"""Everything one run has found, and the same as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from typing import Any

from gcs.benchmark.age import Ages
from gcs.benchmark.growth import Size
from gcs.benchmark.published import FIGURES
from gcs.benchmark.reference import Change
from gcs.benchmark.roofline import Point
from gcs.benchmark.timing import Figure, ratios

FORMAT = "gcs-bench/1"


@dataclass(slots=True)
class Group:
    """Cases that took turns with the reference tracker; it stands among those of the first group of trackers."""

    title: str
    figures: list[Figure]
    reference: Figure

    @property
    def ratios(self) -> dict[str, float]:
        """CPU time of each at one thread in units of the reference tracker's, which itself is left out.

        With more threads it says little: those that wait for each other burn time as long as others keep them waiting.
        """
        return ratios((figure for figure in self.figures if figure.threads == 1), self.reference)


@dataclass(slots=True)
class Machine:
    """What it is, and its measured ceilings: GFLOP/s by threads, GB/s of one; rates: everything that was tried."""

    facts: dict[str, object] = field(default_factory=dict)
    rates: dict[str, float] = field(default_factory=dict)
    peak_gflops: dict[int, float] = field(default_factory=dict)
    bandwidth_gbps: float | None = None
    load: tuple[float, ...] = ()  # of the last minute, before and after: 0 is a quiet machine


@dataclass(slots=True)
class Results:
    """seconds: each part of the run took. notes: what could not be measured, and why."""

    machine: Machine = field(default_factory=Machine)
    trackers: list[Group] = field(default_factory=list)
    stages: list[Group] = field(default_factory=list)
    roofline: list[Point] = field(default_factory=list)
    ages: list[Ages] = field(default_factory=list)
    growth: list[Size] = field(default_factory=list)
    growth_cases: list[Group] = field(default_factory=list)
    memory_mib: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    changes: list[Change] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)

    def groups(self) -> Iterator[Group]:
        """All that have ratios."""
        yield from (*self.trackers, *self.stages, *self.growth_cases)

    def ratios(self) -> dict[str, dict[str, float]]:
        """By group and name."""
        return {group.title: group.ratios for group in self.groups() if group.ratios}

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "format": FORMAT,
            "machine": asdict(self.machine),
            "groups": [
                {"title": group.title, "reference_ms": group.reference.cost_ms, "ratios": group.ratios,
                 "figures": [asdict(figure) for figure in group.figures]}
                for group in self.groups()
            ],
            "roofline": [asdict(point) for point in self.roofline],
            "ages": [asdict(age) for age in self.ages],
            "growth": [{**asdict(size), "total_ms": size.total_ms} for size in self.growth],
            "memory_mib": self.memory_mib,
            "published": [asdict(published) for published in FIGURES],
            "changes": [asdict(change) for change in self.changes if change.moved],
            "notes": self.notes,
            "seconds": self.seconds,
        }  # fmt: skip

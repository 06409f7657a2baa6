"""The table: each row's columns over its seeds, as text and as JSON."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from gcs.scenarios.catalogue import Case
from gcs.scenarios.conditions import LawKind
from gcs.scenarios.measure import Row


@dataclass(frozen=True, slots=True)
class Column:
    """One figure of a row. worse: 1 where more is worse, -1 where less is. floor and floor_frac: what is no change."""

    name: str  # of Row
    title: str
    unit: str
    scale: float
    digits: int
    worse: int
    floor: float
    floor_frac: float = 0.1

    def show(self, value: float | None) -> str:
        """For people."""
        if value is None:
            return "-"
        return "never" if math.isinf(value) else f"{value * self.scale:.{self.digits}f}"


COLUMNS: Final = (
    Column("bearing_rms_deg", "bearing", "deg", 1.0, 2, 1, 0.1),
    Column("distance_rms_frac", "distance", "%", 100.0, 1, 1, 0.01),
    Column("smallest_distance_m", "nearest", "m", 1.0, 1, -1, 0.3, 0.05),
    Column("on_target_frac", "on target", "%", 100.0, 1, -1, 0.02, 0.0),
    Column("reacquire_s", "back after", "s", 1.0, 2, 1, 0.3, 0.2),
    Column("max_gap_s", "gap", "ms", 1000.0, 0, 1, 0.02),
    Column("unsafe", "unsafe", "", 1.0, 0, 1, 0.0, 0.0),
)


@dataclass(frozen=True, slots=True)
class Figure:
    """Over the seeds; spread: the largest less the smallest; infinite where only some are finite."""

    median: float
    spread: float


@dataclass(frozen=True, slots=True)
class Line:
    """A case flown with one law, over its seeds; a column that is none of the case's is left out."""

    case: Case
    law: LawKind
    figures: Mapping[str, Figure]
    rows: tuple[Row, ...]

    @property
    def label(self) -> str:
        """The case's, and the law where it is not the station's."""
        return self.case.label if self.law is LawKind.STATION else f"{self.case.label} {self.law.value}"

    @property
    def problems(self) -> tuple[str, ...]:
        """What must not be, whatever the reference says."""
        found = [f"{self.label}: {reason}" for row in self.rows for reason in row.reasons[:2] if row.unsafe]
        refused = [f"{self.label}: {row.refusal}" for row in self.rows if row.refusal]
        return (*found, *refused)


def line_of(case: Case, law: LawKind, rows: Sequence[Row]) -> Line:
    """Over the seeds; unsafe events are summed up."""
    figures = {}
    for column in COLUMNS:
        values = [value for row in rows if (value := getattr(row, column.name)) is not None]
        if values:
            figures[column.name] = _figure(values) if column.name != "unsafe" else Figure(float(sum(values)), 0.0)
    return Line(case, law, figures, tuple(rows))


def _figure(values: Sequence[float]) -> Figure:
    finite = [value for value in values if math.isfinite(value)]
    spread = max(finite) - min(finite) if len(finite) == len(values) else math.inf if finite else 0.0
    return Figure(statistics.median(values), spread)


def markdown(lines: Sequence[Line]) -> str:
    """The table, columns aligned."""
    heads = ["scenario", *(f"{c.title} {c.unit}".strip() for c in COLUMNS)]
    cells = [[line.label, *(_cell(line, column) for column in COLUMNS)] for line in lines]
    widths = [max(len(row[i]) for row in [heads, *cells]) for i in range(len(heads))]
    rules = ["-" * width for width in widths]
    return "".join(f"| {_joined(row, widths)} |\n" for row in [heads, rules, *cells])


def _joined(row: Sequence[str], widths: Sequence[int]) -> str:
    first, *others = zip(row, widths, strict=True)
    return " | ".join([first[0].ljust(first[1]), *(text.rjust(width) for text, width in others)])


def _cell(line: Line, column: Column) -> str:
    figure = line.figures.get(column.name)
    return column.show(None if figure is None else figure.median)


def as_json(line: Line) -> dict[str, Any]:
    """One object; infinite becomes null, what is no column of the case is left out."""
    c = line.case.conditions
    return {
        "scenario": line.case.scenario.name,
        "mode": line.case.mode.value,
        "delay_s": c.delay_s,
        "fps": c.fps,
        "tracker": c.tracker.value,
        "law": line.law.value,
        "note": line.case.note,
        "seeds": len(line.rows),
        **{name: _plain(figure.median) for name, figure in line.figures.items()},
        "spread": {name: _plain(figure.spread) for name, figure in line.figures.items()},
        "digests": [row.digest for row in line.rows],
    }


def _plain(value: float) -> float | None:
    return round(value, 5) if math.isfinite(value) else None

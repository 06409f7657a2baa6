"""The figures that a change must not make worse: committed with the program, one row per case."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final, TypeAlias

from gcs.errors import GcsError
from gcs.scenarios.conditions import LawKind
from gcs.scenarios.table import COLUMNS, Column, Figure, Line

FILE: Final = Path(__file__).with_name("reference.json")
Reference: TypeAlias = Mapping[str, Mapping[str, Figure]]


class ReferenceFileError(GcsError):
    """The reference cannot be read."""


def load(path: Path = FILE) -> Reference:
    """By label and column; empty where there is no file. Raises ReferenceFileError."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return {label: {name: _figure(*pair) for name, pair in row.items()} for label, row in content.items()}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise ReferenceFileError(f"{path}: {error}") from None


def _figure(median: float | None, spread: float | None) -> Figure:
    return Figure(*(math.inf if value is None else float(value) for value in (median, spread)))


def update(lines: Iterable[Line], path: Path = FILE) -> None:
    """Write these rows of the station; others stay as they are."""
    rows = {label: _row(figures) for label, figures in load(path).items()}
    rows |= {line.label: _row(line.figures) for line in lines if line.law is LawKind.STATION}
    text = ",\n".join(f" {json.dumps(label)}: {json.dumps(rows[label])}" for label in sorted(rows))
    path.write_text("{\n" + text + "\n}\n", encoding="utf-8")


def _row(figures: Mapping[str, Figure]) -> dict[str, list[float | None]]:
    return {
        name: [round(value, 4) if math.isfinite(value) else None for value in (f.median, f.spread)]
        for name, f in figures.items()
    }


def worse(lines: Sequence[Line], reference: Reference) -> list[str]:
    """Each row of the station and column that is worse than the reference by more than its noise."""
    found = []
    for line in lines:
        row = reference.get(line.label, {}) if line.law is LawKind.STATION else {}
        for column in COLUMNS:
            now, then = line.figures.get(column.name), row.get(column.name)
            if now is not None and then is not None and _is_worse(column, now, then):
                found.append(
                    f"{line.label}: {column.title} {column.show(now.median)} {column.unit}".rstrip()
                    + f", the reference is {column.show(then.median)}"
                    + (f" with a spread of {column.show(then.spread)}" if then.spread else "")
                )
    return found


def unknown(lines: Sequence[Line], reference: Reference) -> list[str]:
    """Rows that have no reference."""
    return [line.label for line in lines if line.law is LawKind.STATION and line.label not in reference]


def _is_worse(column: Column, now: Figure, then: Figure) -> bool:
    if math.isinf(then.median):
        return column.worse < 0 and not math.isinf(now.median)
    noise = then.spread + column.floor + column.floor_frac * abs(then.median)
    return column.worse * (now.median - then.median) > noise

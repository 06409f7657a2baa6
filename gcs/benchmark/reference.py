"""Ratios of an earlier run, committed with the program: what has become slower or faster against the same tracker?"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from gcs.benchmark.timing import BenchError

FILE: Final = Path(__file__).with_name("reference.json")
_MOVED: Final = 0.30  # less is the weather of the machine
_FLOOR: Final = 0.005  # of the reference tracker's time: what costs less is not worth a word


class Reference(msgspec.Struct, frozen=True):
    """machine: as `gcs.benchmark.machine.describe`. ratios: CPU time in units of the compact tracker's, by group."""

    machine: dict[str, str]
    ratios: dict[str, dict[str, float]]


@dataclass(frozen=True, slots=True)
class Change:
    """One figure now and then, as ratios."""

    group: str
    name: str
    now: float
    then: float

    @property
    def moved(self) -> bool:
        """By more than a machine's mood explains."""
        if max(self.now, self.then) < _FLOOR:
            return False
        return not 1 - _MOVED <= self.now / self.then <= 1 + _MOVED

    def __str__(self) -> str:
        return f"{self.name}: {self.now:.3g} now, {self.then:.3g} then ({self.now / self.then - 1:+.0%})"


def load(path: Path = FILE) -> Reference | None:
    """None where there is none. BenchError for one that cannot be read."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=Reference)
    except FileNotFoundError:
        return None
    except (OSError, msgspec.DecodeError) as error:
        raise BenchError(f"{path}: {error}") from error


def update(machine: Mapping[str, object], ratios: Mapping[str, Mapping[str, float]], path: Path = FILE) -> None:
    """Write the groups that were measured; others stay as they are."""
    known = load(path)
    merged = {**({} if known is None else known.ratios)}
    merged |= {group: {name: round(value, 4) for name, value in rows.items()} for group, rows in ratios.items()}
    content = {"machine": {name: str(value) for name, value in machine.items()}, "ratios": merged}
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def changes(ratios: Mapping[str, Mapping[str, float]], known: Reference) -> list[Change]:
    """Of all that is in both."""
    return [
        Change(group, name, now, known.ratios[group][name])
        for group, rows in ratios.items()
        for name, now in rows.items()
        if known.ratios.get(group, {}).get(name, 0.0) > 0
    ]

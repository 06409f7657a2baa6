"""What a check is, and what it says."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import TypeAlias

from gcs.config import Config


class Level(Enum):
    """How it looks. SKIP: not looked at, the text says why. Only FAIL makes the whole fail."""

    OK = "ok"
    WARN = "warn"
    FAIL = "fail"
    SKIP = "skip"


@dataclass(frozen=True, slots=True)
class Result:
    """One line of the table. fix: what to do, empty where nothing is to be done. figures: what was measured."""

    name: str
    level: Level
    text: str
    fix: str = ""
    figures: dict[str, float] = field(default_factory=dict)

    def as_json(self) -> dict[str, object]:
        """One JSON line."""
        row: dict[str, object] = {"check": self.name, "level": self.level.value, "text": self.text}
        return {**row, "fix": self.fix or None, **({"figures": self.figures} if self.figures else {})}


@dataclass(frozen=True, slots=True)
class Question:
    """What is to be checked. video, vehicle: None is not looked at. watch_s: how long, each.

    config: with profile, file and arguments in it, as a flight would have it.
    """

    config: Config
    video: str | None = None
    vehicle: str | None = None
    watch_s: float = 5.0
    quick: bool = False
    source: Path | None = None  # a checkout this program runs from


Say: TypeAlias = Callable[[str], None]
Check: TypeAlias = Callable[[Question, Say], Iterable[Result]]


def ok(name: str, text: str, **figures: float) -> Result:
    """All is fine."""
    return Result(name, Level.OK, text, "", figures)


def warn(name: str, text: str, fix: str, **figures: float) -> Result:
    """It works, but not as well as it could."""
    return Result(name, Level.WARN, text, fix, figures)


def fail(name: str, text: str, fix: str, **figures: float) -> Result:
    """It must be put right before a flight."""
    return Result(name, Level.FAIL, text, fix, figures)


def skip(name: str, text: str) -> Result:
    """Not looked at."""
    return Result(name, Level.SKIP, text)

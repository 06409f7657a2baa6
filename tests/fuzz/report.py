"""What a fuzz run came to, as a row of a table; and progress while it runs."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, field
from typing import Final

_SAY_S: Final = 5.0
_KEPT: Final = 20


@dataclass(slots=True)
class Row:
    """problems: the first ones of each kind; memory in MB when warm and in the end; note: what it did exercise."""

    what: str
    count: int = 0
    seconds: float = 0.0
    problems: list[str] = field(default_factory=list)
    problem_count: int = 0
    rss_warm_mb: float = 0.0
    rss_end_mb: float = 0.0
    note: str = ""

    def problem(self, text: str) -> None:
        """Something that must not happen has happened."""
        self.problem_count += 1
        if len(self.problems) < _KEPT:
            self.problems.append(text)


class Progress:
    """A line every few seconds; silent where `quiet`."""

    def __init__(self, what: str, total: int, quiet: bool) -> None:
        self._what, self._total, self._quiet = what, total, quiet
        self._start_s = self._said_s = time.monotonic()

    def at(self, done: int) -> None:
        """So many are done."""
        now_s = time.monotonic()
        if not self._quiet and now_s - self._said_s > _SAY_S:
            self._said_s = now_s
            rate = done / (now_s - self._start_s)
            left_s = (self._total - done) / rate if rate else 0.0
            sys.stderr.write(f"{self._what}: {done} of {self._total}, {left_s:.0f} s left\n")
            sys.stderr.flush()

    @property
    def seconds(self) -> float:
        """Since the start."""
        return time.monotonic() - self._start_s


def table(rows: list[Row]) -> str:
    """For people."""
    lines = [f"{'what':22s} {'how many':>9s} {'s':>6s} {'problems':>8s} {'MB warm':>8s} {'MB end':>7s}  exercised"]
    for row in rows:
        lines.append(
            f"{row.what:22s} {row.count:9d} {row.seconds:6.0f} {row.problem_count:8d}"
            f" {row.rss_warm_mb:8.1f} {row.rss_end_mb:7.1f}  {row.note}"
        )
        lines += [f"    PROBLEM: {text}" for text in row.problems]
    return "\n".join(lines)

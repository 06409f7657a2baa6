"""The one clock of a flight: seconds that never jump; logic takes `now_s` and never reads it."""

from __future__ import annotations

import math
import time
from typing import Protocol


class Clock(Protocol):
    """Where the edges of the program read the time."""

    def now_s(self) -> float:
        """Seconds since some fixed moment; never goes back."""
        ...


class MonotonicClock:
    """`time.monotonic`: indifferent to NTP and to the user's wall clock."""

    def now_s(self) -> float:
        """Seconds of the system's monotonic clock."""
        return time.monotonic()


class FakeClock:
    """A clock for tests: stands still until it is advanced."""

    def __init__(self, now_s: float = 0.0) -> None:
        self._now_s = now_s

    def now_s(self) -> float:
        """The time last set, in s."""
        return self._now_s

    def advance(self, step_s: float) -> float:
        """Move on by step_s (≥ 0) and return the new time; ValueError if it would go back."""
        if not (math.isfinite(step_s) and step_s >= 0):
            raise ValueError(f"a clock cannot move by {step_s} s")
        self._now_s += step_s
        return self._now_s

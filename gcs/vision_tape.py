"""What the vision thread was told besides pictures, so that it can take the same steps again, to the last bit."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.clock import Clock
from tracker.box import Box


@dataclass(frozen=True, slots=True)
class Arrival:
    """A frame was taken. t_source_s: its capture time by the source; correction_s: taken off it."""

    seq: int
    t_source_s: float
    correction_s: float


@dataclass(frozen=True, slots=True)
class Told:
    """Of one step: the frame it began with, then what was read while it caught up (None: nothing was there).

    times_s: every reading of the clock. selection: the one that was taken up, 0 for none. expected: where a hidden
    target should be, as far as that was asked for and answered in time.
    """

    arrivals: tuple[Arrival | None, ...]
    times_s: tuple[float, ...]
    selection: int = 0
    expected: Box | None = None


class Tape:
    """Of the step under way; also the clock of the vision thread, every reading of which is kept."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._arrivals: list[Arrival | None] = []
        self._times_s: list[float] = []
        self.selection = 0
        self.expected: Box | None = None

    def now_s(self) -> float:
        """The clock's."""
        t_s = self._clock.now_s()
        self._times_s.append(t_s)
        return t_s

    def arrived(self, arrival: Arrival | None) -> None:
        """A frame was taken, or looked for in vain."""
        self._arrivals.append(arrival)

    def taken(self) -> Told:
        """Of the step that ends here; the next one begins."""
        told = Told(tuple(self._arrivals), tuple(self._times_s), self.selection, self.expected)
        self._arrivals.clear()
        self._times_s.clear()
        self.selection, self.expected = 0, None
        return told

"""Series of a long flight in little memory: curves that keep their peaks, stretches of time, spreads, paths."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import Final

Point = tuple[float, float]  # time in s, value

_FINEST_S: Final = 0.05
_STEPS_PER_MS: Final = 10


class Curve:
    """Values over time: of each of at most `most` slots of time the lowest and the highest, so no peak is lost.

    gap_s: where nothing came for longer the curve is parted.
    """

    def __init__(self, gap_s: float = 1.0, most: int = 500) -> None:
        self._gap_s, self._most, self._width_s = gap_s, most, _FINEST_S
        self._slots: list[tuple[Point, Point]] = []
        self._newest = -math.inf

    def add(self, t_s: float, value: float) -> None:
        """In order of time, or nearly; what is no number is left out."""
        if not math.isfinite(value):
            return
        index = t_s // self._width_s
        point = (t_s, value)
        if self._slots and index <= self._newest:
            self._slots[-1] = _joined(self._slots[-1], (point, point))
            return
        self._slots.append((point, point))
        self._newest = index
        if len(self._slots) > self._most:
            self._coarsen()

    def _coarsen(self) -> None:
        self._width_s *= 2
        joined: dict[float, tuple[Point, Point]] = {}
        for slot in self._slots:
            index = slot[0][0] // self._width_s
            joined[index] = _joined(joined[index], slot) if index in joined else slot
        self._slots = list(joined.values())
        self._newest = next(reversed(joined))

    def __bool__(self) -> bool:
        return bool(self._slots)

    @property
    def lowest(self) -> float:
        """Of all values; ValueError where there is none."""
        return min(low[1] for low, _ in self._slots)

    @property
    def highest(self) -> float:
        """Of all values; ValueError where there is none."""
        return max(high[1] for _, high in self._slots)

    @property
    def first(self) -> float:
        """The value of the earliest slot."""
        return min(self._slots[0])[1]

    @property
    def last(self) -> float:
        """The value that came last."""
        return max(self._slots[-1])[1]

    @property
    def pieces(self) -> list[list[Point]]:
        """The points to draw, in order, parted where nothing came for a while."""
        found: list[list[Point]] = []
        for slot in self._slots:
            for point in sorted(set(slot)):
                if not found or point[0] - found[-1][-1][0] > max(self._gap_s, 2.5 * self._width_s):
                    found.append([])
                found[-1].append(point)
        return found


def _joined(one: tuple[Point, Point], other: tuple[Point, Point]) -> tuple[Point, Point]:
    return min(one[0], other[0], key=lambda p: p[1]), max(one[1], other[1], key=lambda p: p[1])


class Stretches:
    """When something was so: (start, end) in s, at most `most` of them; what lies near each other becomes one."""

    def __init__(self, most: int = 200) -> None:
        self._most, self._gap_s = most, 0.25
        self.total_s = 0.0
        self.spans: list[tuple[float, float]] = []

    def add(self, start_s: float, end_s: float) -> None:
        """It was so from then to then; in order of time."""
        self.total_s += end_s - start_s
        if self.spans and start_s - self.spans[-1][1] <= self._gap_s:
            self.spans[-1] = (self.spans[-1][0], max(end_s, self.spans[-1][1]))
            return
        self.spans.append((start_s, end_s))
        while len(self.spans) > self._most:
            self._gap_s *= 2
            spans, self.spans = self.spans, []
            for start, end in spans:
                near = bool(self.spans) and start - self.spans[-1][1] <= self._gap_s
                self.spans[-1:] = [(self.spans[-1][0], end)] if near else [*self.spans[-1:], (start, end)]


class Spread:
    """How times are spread, counted in tenths of a millisecond."""

    def __init__(self) -> None:
        self.counts: Counter[int] = Counter()

    def add(self, seconds: float) -> None:
        """One of them."""
        self.counts[round(seconds * 1000 * _STEPS_PER_MS)] += 1

    def percentile_ms(self, share: float) -> float:
        """The least of them, in ms, that this share (0..1) does not exceed; ValueError where there is none."""
        due = max(math.ceil(share * self.counts.total()), 1)
        for step in sorted(self.counts):
            due -= self.counts[step]
            if due <= 0:
                return step / _STEPS_PER_MS
        raise ValueError("nothing was counted")


@dataclass(slots=True)
class Rms:
    """Root of the mean square."""

    count: int = 0
    squares: float = 0.0

    def add(self, value: float) -> None:
        """One more."""
        if math.isfinite(value):
            self.count, self.squares = self.count + 1, self.squares + value * value

    @property
    def value(self) -> float | None:
        """None where nothing came."""
        return math.sqrt(self.squares / self.count) if self.count else None


@dataclass(frozen=True, slots=True)
class Place:
    """A point of a path, m north and east of home; kind: what was going on."""

    t_s: float
    north_m: float
    east_m: float
    kind: str


@dataclass(slots=True)
class Trail:
    """A path seen from above, of at most `most` places; where more come they stand further apart in time."""

    most: int = 1500
    places: list[Place] = field(default_factory=list)
    _step_s: float = 0.2

    def add(self, place: Place) -> None:
        """In order of time; a new kind is always kept."""
        if not (math.isfinite(place.north_m) and math.isfinite(place.east_m)):
            return
        last = self.places[-1] if self.places else None
        if last is not None and place.kind == last.kind and place.t_s - last.t_s < self._step_s:
            return
        self.places.append(place)
        if len(self.places) > self.most:
            self._step_s *= 2
            self.places = self.places[::2]

"""From the light on the sensor to the command at the vehicle: where the time goes, picture by picture."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, fields
from statistics import median
from typing import Final

from gcs.flight_vision import Seen

_SHOWN_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class Budget:
    """Seconds. glass: light to arrival of the encoded picture here; decode; wait: until the tracker took it.

    track: tracker; control: from its answer to the setpoint; link: the setpoint's way to the vehicle.
    """

    glass_s: float
    decode_s: float
    wait_s: float
    track_s: float
    control_s: float
    link_s: float

    @classmethod
    def of(cls, seen: Seen, now_s: float, link_s: float) -> Budget:
        """Of the setpoint that leaves at now_s and is the first to know of this picture."""
        frame = seen.frame
        decoded_s, taken_s = frame.t_arrival_s + frame.decode_s, seen.t_done_s - seen.track_s
        return cls(
            glass_s=frame.t_arrival_s - frame.t_capture_s,
            decode_s=frame.decode_s,
            wait_s=taken_s - decoded_s,
            track_s=seen.track_s,
            control_s=now_s - seen.t_done_s,
            link_s=link_s,
        )

    @property
    def total_s(self) -> float:
        """Glass to command."""
        return self.glass_s + self.decode_s + self.wait_s + self.track_s + self.control_s + self.link_s

    @property
    def parts_ms(self) -> str:
        """Each by its name, in ms."""
        parts = (
            ("glass", self.glass_s), ("decode", self.decode_s), ("wait", self.wait_s),
            ("tracker", self.track_s), ("control", self.control_s), ("link", self.link_s),
        )  # fmt: skip
        return ", ".join(f"{name} {seconds * 1000:.0f}" for name, seconds in parts)

    def __str__(self) -> str:
        return f"latency {self.total_s * 1000:.0f} ms ({self.parts_ms})"


class LatencyMeter:
    """Give it every picture that was measured, and ask at each tick. link_s: the way to the vehicle.

    unknown_link_s: taken for it where the vehicle does not answer TIMESYNC.
    """

    def __init__(self, unknown_link_s: float) -> None:
        self._unknown_link_s = self.link_s = max(unknown_link_s, 0.0)
        self._unanswered: Seen | None = None

    def saw(self, seen: Seen) -> None:
        """The newest picture; the next tick answers it."""
        self._unanswered = seen

    def forget(self) -> None:
        """Another target."""
        self._unanswered = None

    def answered(self, now_s: float, one_way_s: float | None) -> Budget | None:
        """The budget of the picture that a tick now is the first to know of; None where there is no new one."""
        self.link_s = self._unknown_link_s if one_way_s is None else one_way_s
        seen, self._unanswered = self._unanswered, None
        return None if seen is None else Budget.of(seen, now_s, self.link_s)


class BudgetDisplay:
    """What a person can read: each part's median over the last second."""

    def __init__(self) -> None:
        self._recent: deque[tuple[float, Budget]] = deque()

    def note(self, t_s: float, budget: Budget) -> None:
        """A budget was measured."""
        self._recent.append((t_s, budget))

    def at(self, now_s: float) -> Budget | None:
        """None where nothing was measured lately."""
        while self._recent and now_s - self._recent[0][0] > _SHOWN_S:
            self._recent.popleft()
        if not self._recent:
            return None
        return Budget(*(median(getattr(budget, f.name) for _, budget in self._recent) for f in fields(Budget)))

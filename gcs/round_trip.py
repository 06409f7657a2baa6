"""Does the vehicle hear us? It answers TIMESYNC; answers that end while it still talks tell that it does not."""

from __future__ import annotations

from collections import deque
from statistics import median
from typing import Final

_ASK_S: Final = 0.1  # often, so that a second without an answer is no bad luck: at 20 % loss once in 45 minutes
_UNHEARD_S: Final = 1.0
_PAUSE_S: Final = 0.5  # after a longer pause of ours the count begins anew
_OPEN: Final = 50  # requests that may still be answered
_ANSWERS: Final = 9  # the median of so many is the round trip: one of them alone may have waited in a stall
_MOST_ONE_WAY_S: Final = 0.2


class RoundTrip:
    """`ask` every tick, `note` every TIMESYNC of the vehicle. One that has never answered is not judged.

    rtt_s: of the newest answer, None before the first. one_way_s: half of the usual one, at most 0.2 s.
    """

    def __init__(self) -> None:
        self._open: deque[tuple[int, float]] = deque(maxlen=_OPEN)  # (ts1, when asked)
        self._begun_s = self._asked_s = float("-inf")
        self._answer_s: float | None = None
        self.rtt_s: float | None = None
        self.one_way_s: float | None = None
        self._recent_s: deque[float] = deque(maxlen=_ANSWERS)

    def ask(self, now_s: float) -> int | None:
        """ts1 (ns) of the request to be sent now, None if none is due."""
        if now_s - self._asked_s < _ASK_S - 1e-3:
            return None
        if now_s - self._asked_s > _PAUSE_S:
            self._begun_s = now_s
        self._asked_s = now_s
        stamp_ns = round(now_s * 1e9)
        self._open.append((stamp_ns, now_s))
        return stamp_ns

    def note(self, tc1: int, ts1: int, t_s: float) -> None:
        """A TIMESYNC arrived at t_s; requests (tc1 = 0) and answers to others are passed over."""
        asked_s = next((asked_s for stamp_ns, asked_s in self._open if stamp_ns == ts1), None)
        if tc1 != 0 and asked_s is not None:
            self._answer_s, self.rtt_s = t_s, t_s - asked_s
            self._recent_s.append(self.rtt_s)
            self.one_way_s = min(median(self._recent_s) / 2, _MOST_ONE_WAY_S)

    def is_unheard(self, now_s: float) -> bool:
        """Whether answers that used to come have stayed away for a second of asking."""
        return self._answer_s is not None and now_s - max(self._answer_s, self._begun_s) > _UNHEARD_S

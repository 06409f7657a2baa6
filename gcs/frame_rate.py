"""How many pictures a second are through the tracker."""

from __future__ import annotations

from collections import deque
from typing import Final

_FRAMES: Final = 20
_LEAST_S: Final = 0.2  # two that come together after a pause tell no rate


class FrameRate:
    """Note the time of each picture; the rate over the last twenty."""

    def __init__(self) -> None:
        self._times_s: deque[float] = deque(maxlen=_FRAMES)

    def note(self, t_s: float) -> None:
        """One was through at t_s."""
        self._times_s.append(t_s)

    @property
    def fps(self) -> float:
        """0 until it can be told."""
        span_s = self._times_s[-1] - self._times_s[0] if self._times_s else 0.0
        return (len(self._times_s) - 1) / span_s if span_s >= _LEAST_S else 0.0

"""Does the vehicle do what we send, and only that: its echo (POSITION_TARGET_LOCAL_NED) against our setpoints.

An echo that stays behind what is sent means that the vehicle no longer hears us, though we hear it; an echo of
what was never sent means that somebody else steers as well. A vehicle that echoes nothing is not judged.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from control.types import Vec3

_LOST_S: Final = 1.2  # the vehicle shows to know nothing newer of what we sent: it does not hear us
_STREAM_S: Final = 0.4  # after a longer pause a stream begins anew
_OURS_S: Final = 10.0  # what is older is not ours any more
_STRANGE_COUNT: Final = 2
_STRANGE_S: Final = 2.0
_SETTLE_S: Final = 0.5  # at first the vehicle may still tell of what it did before
_TOLERANCE_MPS: Final = 0.5
_TOLERANCE_FRAC: Final = 0.1


class EchoMonitor:
    """Per tick `judge` while the vehicle is in external control, else `reset`; and `sent` for what leaves."""

    def __init__(self) -> None:
        self._sent: deque[tuple[float, Vec3]] = deque()
        self._strange_s: deque[float] = deque(maxlen=_STRANGE_COUNT)
        self.reset()

    def reset(self) -> None:
        """The vehicle is not in external control: its echo says nothing about us."""
        self._begun_s = self._echo_t_s = self._known_s = -math.inf
        self._sent.clear()
        self._strange_s.clear()
        self.is_lost = self.is_foreign = False

    def sent(self, t_s: float, velocity_ned_mps: Vec3) -> None:
        """A setpoint has left."""
        if not self._streams(t_s):
            self._begun_s = self._known_s = t_s
            self._strange_s.clear()
        self._sent.append((t_s, velocity_ned_mps))
        while self._sent[0][0] < t_s - _OURS_S:
            self._sent.popleft()

    def judge(self, now_s: float, echo_t_s: float | None, echo_ned_mps: Vec3) -> None:
        """Set `is_lost` and `is_foreign`, given the newest echo (None: never) and when it arrived."""
        if not self._streams(now_s):  # what it does by itself, as climbing after take-off, is nobody's fault
            self.is_lost = self.is_foreign = False
            return
        if echo_t_s is not None and echo_t_s > max(self._echo_t_s, self._begun_s + _SETTLE_S):
            self._note(echo_t_s, echo_ned_mps)
        self.is_lost = now_s - self._echo_t_s <= _LOST_S and now_s - self._known_s > _LOST_S
        enough = len(self._strange_s) == _STRANGE_COUNT
        self.is_foreign = enough and now_s - self._strange_s[0] <= _STRANGE_S

    def _streams(self, now_s: float) -> bool:
        return bool(self._sent) and now_s - self._sent[-1][0] <= _STREAM_S

    def _note(self, t_s: float, echo_ned_mps: Vec3) -> None:
        self._echo_t_s = t_s
        newest_s = next((at_s for at_s, sent in reversed(self._sent) if _alike(sent, echo_ned_mps)), None)
        if newest_s is not None:
            self._known_s = max(self._known_s, newest_s)
        elif not _alike((0.0, 0.0, 0.0), echo_ned_mps):
            self._strange_s.append(t_s)


def _alike(sent: Vec3, echo: Vec3) -> bool:
    """Equal but for what a vehicle may round off or limit."""
    return math.dist(sent, echo) <= _TOLERANCE_MPS + _TOLERANCE_FRAC * math.hypot(*sent)

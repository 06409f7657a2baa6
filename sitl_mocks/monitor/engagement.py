"""Who let the vehicle fly: the operator's confirmations against what the station then does (U4, and when U5 holds)."""

from __future__ import annotations

from dataclasses import dataclass

from sitl_mocks.monitor.limits import MonitorLimits, Truth
from sitl_mocks.monitor.setpoints import SILENCE_S

_ORDER_S = 1.0  # an entry that long after the station's mode request is the station's


@dataclass(slots=True)
class Engagement:
    """Each stretch of flying under external control needs a confirmation of its own, told through `confirm`.

    A stretch begins when the vehicle enters external mode in the air at the station's doing, or with the first
    setpoint it obeys in the air (ArduCopter is in GUIDED since its take-off). It ends when the mode is left, or when
    the stream was silent for stream_break_s.
    """

    limits: MonitorLimits
    entries: int = 0
    following: bool = False  # a moving setpoint has been obeyed in this stretch
    _external: bool = False
    _decided: bool = False  # this stretch has used up its confirmation, or has been counted
    _confirmed_s: float | None = None
    _setpoint_s: float | None = None
    _ordered_s: float | None = None

    def confirm(self, now_s: float) -> None:
        """The operator has just confirmed: allows one stretch."""
        self._confirmed_s = now_s

    def order(self, now_s: float) -> None:
        """The station asks for a mode."""
        self._ordered_s = now_s

    def watch(self, now_s: float, truth: Truth) -> str | None:
        """Follow the mode; the words of an unsafe outcome, or None."""
        entered = truth.external and not self._external
        self._external = truth.external
        if not truth.external:
            self._decided = self.following = False
            return None
        if not entered:
            return None
        self.entries += 1
        ours = _within(now_s, self._setpoint_s, SILENCE_S) or _within(now_s, self._ordered_s, _ORDER_S)
        self._setpoint_s = now_s  # silence before it is no break in the stretch that begins now
        return self._decide(now_s, must=ours) if truth.obeys else None

    def setpoint(self, now_s: float, truth: Truth, *, still: bool) -> str | None:
        """A setpoint has arrived; the words of an unsafe outcome, or None."""
        last_s, self._setpoint_s = self._setpoint_s, now_s
        if not truth.obeys:
            return None
        pause_s = self.limits.stream_break_s
        if pause_s is not None and last_s is not None and now_s - last_s > pause_s:
            self._decided = self.following = False
        hit = self._decide(now_s, must=not still)
        self.following = self.following or not still
        return hit

    def _decide(self, now_s: float, *, must: bool) -> str | None:
        """Use up a fresh confirmation; without one it is unsafe where there must be one."""
        if self._decided:
            return None
        if _within(now_s, self._confirmed_s, self.limits.confirmation_lasts_s):
            self._confirmed_s, self._decided = None, True
            return None
        self._decided = must
        return "flying under external control without a confirmation" if must else None


def _within(now_s: float, then_s: float | None, limit_s: float) -> bool:
    return then_s is not None and now_s - then_s <= limit_s

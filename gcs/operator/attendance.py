"""Whether anybody is left of those who let the vehicle follow: a dead phone must not be followed by a long flight.

Pure; page and MAVLink camera have one each, for their own people.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import Final

LOOK_S: Final = 0.25
_WARNED_FRAC: Final = 0.5


class Absence(Enum):
    """How long nobody has been heard during a follow that is theirs."""

    NONE = "somebody is there, or it concerns nobody here"
    LONG = "long enough to warn"
    TOO_LONG = "so long that the follow must end"


class Attendance:
    """abandoned_s: unheard for so long all of them have left; None: never."""

    def __init__(self, abandoned_s: float | None) -> None:
        self.abandoned_s = math.inf if abandoned_s is None else abandoned_s
        self._heard_s = -math.inf
        self._theirs = False

    def took(self, now_s: float) -> None:
        """One of them has confirmed a follow, or taken control of one."""
        self._theirs = True
        self._heard_s = max(self._heard_s, now_s)

    def look(self, now_s: float, heard_s: float, *, engaged: bool, elsewhere: bool) -> Absence:
        """Now. heard_s: when any of them was heard last; elsewhere: somebody who is not one of them is in control."""
        self._heard_s = max(self._heard_s, heard_s)
        if not engaged or elsewhere:
            self._theirs = False
        unheard_s = now_s - self._heard_s
        if not self._theirs or unheard_s < _WARNED_FRAC * self.abandoned_s:
            return Absence.NONE
        return Absence.LONG if unheard_s < self.abandoned_s else Absence.TOO_LONG

    def left_s(self, now_s: float) -> float:
        """Until the follow must end, where nobody comes back."""
        return max(0.0, self._heard_s + self.abandoned_s - now_s)

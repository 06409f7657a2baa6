"""Every cause that refuses, slows or ends a follow, one row each; this table is what the station promises.

As in PX4's failsafe framework: severities are ordered, the worst active one decides, and every cause says how
what it did is undone. The engine that applies it is `control.engagement`.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum, IntEnum

__all__ = ["Cause", "Clear", "Severity", "leading", "worst"]


class Severity(IntEnum):
    """What a cause does to a follow under way, worst last."""

    NONE = 0  # nothing: it only keeps a follow from beginning
    WARN = 1  # the operator is told
    COAST = 2  # velocity fades to zero
    ZERO = 3  # zero velocity
    RELEASE = 4  # zero with the request for hold, until hold is seen, then silence
    SILENT = 5  # silence
    TAKEN_OVER = 6  # silence, and no mode is asked for: the vehicle is somebody else's
    ABORT = 7  # as RELEASE, and against everything: the operator's own order


class Clear(Enum):
    """How what a cause did is undone."""

    WHEN_GONE = "by itself, when the cause is gone"
    BY_SELECTION = "the operator selects again or acknowledges, and confirms"
    BY_ACKNOWLEDGE = "the operator acknowledges, and confirms"


_GONE, _SELECT, _ACKNOWLEDGE = Clear.WHEN_GONE, Clear.BY_SELECTION, Clear.BY_ACKNOWLEDGE
_FREE, _REFUSES = False, True


class Cause(Enum):
    """A row: its value is the text in the operator's words; whether it refuses a confirmation; what it does."""

    refuses: bool
    severity: Severity
    clear: Clear

    def __new__(cls, text: str, refuses: bool, severity: Severity, clear: Clear) -> Cause:
        """Make the row."""
        row = object.__new__(cls)
        row._value_, row.refuses, row.severity, row.clear = text, refuses, severity, clear
        return row

    # fmt: off
    # What is needed to begin; a few of them also end what has begun.
    NOT_SELECTED = "no target is selected", _REFUSES, Severity.NONE, _GONE
    NO_VIDEO = "no fresh video", _REFUSES, Severity.NONE, _GONE  # in flight the target is unseen
    NO_TARGET = "the target is not being measured", _REFUSES, Severity.NONE, _GONE
    LOW_CONFIDENCE = "the tracker is not sure enough of the target", _REFUSES, Severity.NONE, _GONE
    NO_DISTANCE = "the distance to the target is unknown: type it", _REFUSES, Severity.NONE, _GONE
    LATENCY = "the picture reaches the controls too late", _REFUSES, Severity.NONE, _GONE
    ATTITUDE_SLOW = "attitude arrives too slowly", _REFUSES, Severity.NONE, _GONE
    LINK_LOST = "no heartbeat from the vehicle", _REFUSES, Severity.RELEASE, _SELECT
    TELEMETRY_STALE = "attitude or position is too old", _REFUSES, Severity.RELEASE, _SELECT
    NOT_ARMED = "the vehicle is not armed", _REFUSES, Severity.TAKEN_OVER, _ACKNOWLEDGE
    NOT_IN_AIR = "the vehicle is not in the air", _REFUSES, Severity.NONE, _GONE
    TOO_LOW = "the vehicle is too low", _REFUSES, Severity.NONE, _GONE  # in flight the gate keeps the floor
    MODE = "the vehicle is neither in hold nor in external control", _REFUSES, Severity.NONE, _GONE
    FAILSAFE = "the vehicle has a failsafe active", _REFUSES, Severity.TAKEN_OVER, _ACKNOWLEDGE
    BATTERY = "the battery is too low", _REFUSES, Severity.WARN, _GONE
    OUTSIDE_FENCE = "the vehicle is at or outside the fence", _REFUSES, Severity.RELEASE, _SELECT
    AUDIT = "the vehicle's parameters are not safe for following", _REFUSES, Severity.NONE, _GONE
    OWN_LAG = "our own program was late a moment ago", _REFUSES, Severity.WARN, _GONE
    CAMERA_WRONG = (
        "the picture does not turn as the vehicle does: is the camera mirrored, rolled or on a gimbal?",
        _REFUSES, Severity.RELEASE, _ACKNOWLEDGE,
    )
    ECHO_LOST = "the vehicle does not do what is sent: it may not hear us", _REFUSES, Severity.RELEASE, _ACKNOWLEDGE
    FOREIGN_SETPOINTS = "somebody else is steering the vehicle as well", _REFUSES, Severity.RELEASE, _ACKNOWLEDGE
    ACKNOWLEDGE = "the last follow ended by itself: acknowledge or select again first", _REFUSES, Severity.NONE, _SELECT
    # What is only told.
    LOSSY = "much of the telemetry is lost on the way", _FREE, Severity.WARN, _GONE
    FOREIGN_STATION = "another ground station is on the link", _FREE, Severity.WARN, _GONE
    # What slows or ends a follow, and cannot be there before it.
    TARGET_UNSEEN = "the target is not seen", _FREE, Severity.COAST, _GONE
    TARGET_AWAY = "the target has not come back yet", _FREE, Severity.ZERO, _GONE
    TARGET_LOST = "the target was lost for too long", _FREE, Severity.RELEASE, _SELECT
    OWN_GAP = "our own program paused", _FREE, Severity.RELEASE, _SELECT
    STALLED = "the controller stopped asking", _FREE, Severity.RELEASE, _SELECT
    MODE_REFUSED = "the vehicle did not take up external control", _FREE, Severity.RELEASE, _SELECT
    HOLD_REFUSED = "the vehicle did not take up hold", _FREE, Severity.SILENT, _ACKNOWLEDGE
    MODE_CHANGED = "the pilot or the vehicle changed the mode", _FREE, Severity.TAKEN_OVER, _ACKNOWLEDGE
    ABORT = "the operator stopped it", _FREE, Severity.ABORT, _SELECT
    # fmt: on


def worst(causes: Iterable[Cause]) -> Severity:
    """The severity that decides; NONE for no cause."""
    return max((cause.severity for cause in causes), default=Severity.NONE)


def leading(causes: Iterable[Cause]) -> tuple[Cause, ...]:
    """The causes that decide, in their order."""
    active = tuple(causes)
    return tuple(cause for cause in active if cause.severity is worst(active))

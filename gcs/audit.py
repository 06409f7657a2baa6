"""What the vehicle's parameters must be before anybody is followed: a table per autopilot, judged without I/O.

The vehicle's own time-outs are the last thing that stops it when this program has died. Nothing here is ever
set: the operator is told what to set, or accepts a parameter by its name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType
from typing import Final, TypeAlias

from gcs.errors import GcsError

STATION_SYSTEM_ID: Final = 255  # gcs.wire.SYSTEM_ID; kept apart so that configurations load without a wire
_Test: TypeAlias = Callable[[float], bool]


class Level(Enum):
    """How a parameter is judged; UNSAFE refuses to engage."""

    FINE = "fine"
    ADVICE = "advice"
    UNSAFE = "unsafe"


class AuditError(GcsError):
    """A name that no audit asks for."""


@dataclass(frozen=True, slots=True)
class Rule:
    """One parameter. names: the newest firmware's name first. wanted: for people; set_to: a value that is fine.

    What is neither `fine` nor `tolerable` is unsafe, and so is a value that cannot be read.
    """

    names: tuple[str, ...]
    wanted: str
    set_to: float
    why: str
    fine: _Test
    tolerable: _Test = lambda value: False


@dataclass(frozen=True, slots=True)
class Finding:
    """A parameter as read (None: it did not answer) and what is thought of it."""

    name: str
    value: float | None
    wanted: str
    set_to: float
    level: Level
    why: str
    accepted: bool = False

    @property
    def refuses(self) -> bool:
        """It alone keeps a follow from starting."""
        return self.level is Level.UNSAFE and not self.accepted

    def __str__(self) -> str:
        state = "cannot be read" if self.value is None else f"is {self.value:g}"
        return f"{self.name} {state}, wanted {self.wanted}"


@dataclass(frozen=True, slots=True)
class Audit:
    """The findings on one vehicle, in the order of the table."""

    autopilot: str
    findings: tuple[Finding, ...]

    @property
    def ok(self) -> bool:
        """Whether a follow may start."""
        return not self.refusing

    @property
    def refusing(self) -> tuple[Finding, ...]:
        """What keeps a follow from starting."""
        return tuple(finding for finding in self.findings if finding.refuses)

    @property
    def problem(self) -> str:
        """Why not, in one line that says what to set; empty if nothing is unsafe."""
        if self.ok:
            return ""
        said = "; ".join(f"{finding} (set {finding.set_to:g})" for finding in self.refusing)
        return f"unsafe vehicle parameters: {said}; set them, or accept each by its name"


def _any(value: float) -> bool:
    return True


def _among(*values: float) -> _Test:
    return lambda value: value in values


def _within(low: float, high: float) -> _Test:
    return lambda value: low <= value <= high


def _has_bit(*bits: int) -> _Test:
    return lambda value: any(int(value) >> bit & 1 for bit in bits)


def _lacks_bit(bit: int) -> _Test:
    return lambda value: not int(value) >> bit & 1


_PX4: Final = (
    Rule(
        ("COM_OF_LOSS_T",), "0.2 to 0.5 s", 0.5,
        "how long it flies on at its last velocity when this program has died",
        _within(0.2, 0.5), _within(0.0, 1.0),
    ),
    Rule(
        ("COM_OBL_RC_ACT",), "5, Hold", 5,
        "what it does then: in 0 to 2 without sticks it drifts on and sinks until it lands; 3 returns, 4 lands",
        _among(5), _among(3, 4),
    ),
    Rule(
        ("COM_RC_OVERRIDE",), "bit 1 set (3)", 3,
        "otherwise the sticks, which need a radio control, do not take over in Offboard",
        _has_bit(1),
    ),
    Rule(
        ("GF_ACTION",), "2, Hold (or 3 Return, 5 Land)", 2,
        "0 and 1 only watch while it flies out of its fence; 4 stops the motors",
        _among(2, 3, 5),
    ),
    Rule(
        ("GF_MAX_HOR_DIST",), "your field's radius, 10 to 1000 m", 500,
        "0 is no fence; the vehicle's own is the one that holds when ours is wrong",
        _within(10, 1000), _within(1, math.inf),
    ),
    # Setpoints that end are found by COM_OF_LOSS_T, so this guards what comes after a follow. 5 and 6 cut the motors.
    Rule(
        ("NAV_DLL_ACT",), "2, Return (or 3 Land)", 2,
        "0 never misses a ground station that is gone; 1 goes back to Offboard by itself when it returns",
        _among(2, 3), _among(0, 1),
    ),
    Rule(
        ("COM_DL_LOSS_T",), "5 to 10 s", 10,
        "how long a ground station may be gone before NAV_DLL_ACT",
        _within(5, 10), _any,
    ),
    Rule(
        ("COM_RCL_EXCEPT",), "bit 2 clear", 0,
        "with it the loss of the pilot's radio control goes unnoticed in Offboard",
        _lacks_bit(2), _any,
    ),
    Rule(
        ("COM_RC_LOSS_T",), "at most 1 s", 0.5,
        "how long the pilot's radio control may be gone unnoticed",
        _within(0, 1), _any,
    ),
    Rule(
        ("COM_LOW_BAT_ACT",), "2 or 3, Land or Return in time", 3,
        "0 only warns: following ends with the battery",
        _among(2, 3), _any,
    ),
)  # fmt: skip

_ARDUCOPTER: Final = (
    Rule(
        ("GUID_TIMEOUT",), "0.2 to 1 s", 1,
        "how long it flies on at its last velocity when this program has died; 3 by default",
        _within(0.2, 1.0), _within(0.1, 2.0),
    ),
    # Guided itself holds after GUID_TIMEOUT but stays Guided, and obeys whoever speaks next.
    Rule(
        ("FS_GCS_ENABLE",), "1, return (or 5, land)", 1,
        "0 leaves it in Guided for ever when the ground station is gone, obeying whoever speaks next",
        _within(1, 7),
    ),
    Rule(
        ("MAV_GCS_SYSID", "SYSID_MYGCS"), f"{STATION_SYSTEM_ID}, this station", STATION_SYSTEM_ID,
        "only heartbeats of this system count for FS_GCS_ENABLE",
        _among(STATION_SYSTEM_ID),
    ),
    Rule(
        ("FENCE_ENABLE",), "1", 1,
        "the vehicle's own fence is the one that holds when ours is wrong",
        _among(1),
    ),
    Rule(
        ("FENCE_TYPE",), "bit 1 (circle) or 2 (polygon) set (7)", 7,
        "otherwise its fence has no sides",
        _has_bit(1, 2),
    ),
    Rule(
        ("FENCE_ACTION",), "1, return or land (or 2 to 5)", 1,
        "0 only reports while it flies out of its fence",
        _within(1, 5),
    ),
    Rule(
        ("FENCE_RADIUS",), "your field's radius, 30 to 1000 m", 300,
        "further out nobody sees what it does",
        _within(30, 1000), _any,
    ),
    Rule(
        ("FLTMODE_CH",), "the mode switch's channel, 5 to 16", 5,
        "0 takes the mode switch, which always wins, away from the pilot",
        _within(1, 16),
    ),
    Rule(
        ("RC_OPTIONS",), "bit 0 clear (32)", 32,
        "with it the pilot's receiver is ignored",
        _lacks_bit(0),
    ),
    Rule(
        ("FS_THR_ENABLE",), "1 to 7", 1,
        "0 never misses the pilot's radio control",
        _within(1, 7), _any,
    ),
    Rule(
        ("FS_OPTIONS",), "bit 2 clear (16)", 16,
        "with it the loss of the pilot's radio control goes unheeded in Guided",
        _lacks_bit(2), _any,
    ),
)  # fmt: skip

RULES: Mapping[str, tuple[Rule, ...]] = MappingProxyType({"PX4": _PX4, "ArduCopter": _ARDUCOPTER})
KNOWN: Final = frozenset(name for rules in RULES.values() for rule in rules for name in rule.names)


def known_name(text: str) -> str:
    """The name in its own spelling; AuditError if no audit asks for it."""
    name = text.strip().upper()
    if name not in KNOWN:
        raise AuditError(f"{text!r} is no parameter of the audit (known: {', '.join(sorted(KNOWN))})")
    return name


def judge(autopilot: str, values: Mapping[str, float], accepted: Collection[str] = ()) -> Audit:
    """The findings on what was read; accepted: names the operator takes as they are. KeyError: no such autopilot."""
    return Audit(autopilot, tuple(_judge(rule, values, accepted) for rule in RULES[autopilot]))


def _judge(rule: Rule, values: Mapping[str, float], accepted: Collection[str]) -> Finding:
    name = next((name for name in rule.names if name in values), rule.names[0])
    value = values.get(name)
    level = Level.ADVICE if rule.tolerable is _any else Level.UNSAFE  # unread: the worst it could be
    if value is not None and math.isfinite(value):
        level = Level.FINE if rule.fine(value) else Level.ADVICE if rule.tolerable(value) else Level.UNSAFE
    is_accepted = any(name in accepted for name in rule.names)
    return Finding(name, value, rule.wanted, float(rule.set_to), level, rule.why, is_accepted)

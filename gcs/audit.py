"""Whether the vehicle's parameters are safe for being followed by it: the rules applied, without I/O.

The vehicle's own time-outs are the last thing that stops it when this program has died. Nothing here is ever
set: the operator is told what to set, or accepts a parameter by its name.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType
from typing import Final

from gcs.audit_follow_mode import ARDUCOPTER_FOLLOW, PX4_FOLLOW
from gcs.audit_rules import ARDUCOPTER, PX4, Rule, anything
from gcs.backend import Backend
from gcs.errors import GcsError


class Level(Enum):
    """How a parameter is judged; UNSAFE refuses to engage."""

    FINE = "fine"
    ADVICE = "advice"
    UNSAFE = "unsafe"


class AuditError(GcsError):
    """A name that no audit asks for."""


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


RULES: Mapping[str, tuple[Rule, ...]] = MappingProxyType({"PX4": PX4, "ArduCopter": ARDUCOPTER})
_FOLLOW_RULES: Mapping[str, tuple[Rule, ...]] = MappingProxyType({"PX4": PX4_FOLLOW, "ArduCopter": ARDUCOPTER_FOLLOW})
KNOWN: Final = frozenset(
    name for table in (RULES, _FOLLOW_RULES) for rules in table.values() for rule in rules for name in rule.names
)


def rules_of(autopilot: str, backend: Backend = Backend.SETPOINTS) -> tuple[Rule, ...]:
    """What is judged where a follow reaches the vehicle in this way. KeyError: no such autopilot."""
    return (_FOLLOW_RULES if backend is Backend.FOLLOW_TARGET else RULES)[autopilot]


def known_name(text: str) -> str:
    """The name in its own spelling; AuditError if no audit asks for it."""
    name = text.strip().upper()
    if name not in KNOWN:
        raise AuditError(f"{text!r} is no parameter of the audit (known: {', '.join(sorted(KNOWN))})")
    return name


def judge(
    autopilot: str,
    values: Mapping[str, float],
    accepted: Collection[str] = (),
    backend: Backend = Backend.SETPOINTS,
) -> Audit:
    """The findings on what was read; accepted: names the operator takes as they are. KeyError: no such autopilot."""
    return Audit(autopilot, tuple(_judge(rule, values, accepted) for rule in rules_of(autopilot, backend)))


def _judge(rule: Rule, values: Mapping[str, float], accepted: Collection[str]) -> Finding:
    name = next((name for name in rule.names if name in values), rule.names[0])
    value = values.get(name)
    level = Level.ADVICE if rule.tolerable is anything else Level.UNSAFE  # unread: the worst it could be
    if value is not None and math.isfinite(value):
        fine = rule.fine(value) if rule.together is None else rule.together(values)
        level = Level.FINE if fine else Level.ADVICE if rule.tolerable(value) else Level.UNSAFE
    is_accepted = any(name in accepted for name in rule.names)
    return Finding(name, value, rule.wanted, float(rule.set_to), level, rule.why, is_accepted)

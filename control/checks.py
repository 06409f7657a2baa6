"""What a number, a stamp or a setting must be to be believed. Standard library only; lying subclasses are refused."""

from __future__ import annotations

from dataclasses import field, fields
from typing import Any, Final, TypeGuard

_AHEAD_S: Final = 0.05  # a stamp may be this much newer than now: another thread made it during this tick


def ranged(low: float, default: float, high: float) -> float:
    """A field with its ceilings: what configuration may choose from, fixed in code."""
    return field(default=default, metadata={"low": low, "high": high})  # pragma: no mutate


def optional(low: float, high: float) -> float | None:
    """The same for a limit that is off unless configuration sets it."""
    return field(default=None, metadata={"low": low, "high": high})  # pragma: no mutate


def check_ranges(config: Any) -> None:
    """ValueError naming field, range and value, for each field made by `ranged` or `optional`."""
    for f in fields(config):
        value = getattr(config, f.name)
        if "low" not in f.metadata or (value is None and f.default is None):
            continue
        low, high = f.metadata["low"], f.metadata["high"]
        if not finite(value) or not low <= value <= high:
            raise ValueError(f"{f.name} must be from {low:g} to {high:g}, not {value!r}")


def fresh(t_s: object, now_s: object, age_s: float) -> bool:
    """Whether the stamp is a number, no older than age_s and not from the future."""
    return finite(t_s) and finite(now_s) and -_AHEAD_S <= now_s - t_s <= age_s


def vector(value: object) -> bool:
    """Whether it is a tuple of three finite numbers."""
    return type(value) is tuple and len(value) == 3 and all(map(finite, value))


def finite(value: object) -> TypeGuard[float]:
    """A plain number that arithmetic cannot overflow; NaN, inf, bool, text, None and subclasses are not."""
    return (type(value) is float or type(value) is int) and abs(value) < 1e9

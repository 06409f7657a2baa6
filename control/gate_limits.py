"""The ceilings no configuration can lift, and the checks the gate is made of. Standard library only."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Final, TypeGuard

TICK_S: Final = 0.05
_AHEAD_S: Final = 0.05  # a stamp may be this much newer than now: another thread made it during this tick


def ranged(low: float, default: float, high: float) -> float:
    """A field with its ceilings: what configuration may choose from, fixed here."""
    return field(default=default, metadata={"low": low, "high": high})


@dataclass(frozen=True, slots=True)
class Limits:
    """What may leave the gate: defaults, and in each field the range that configuration may choose from.

    Heights are above home, the fence is a circle in NED metres. ValueError names field, range and value.
    """

    max_speed_mps: float = ranged(0.1, 8.0, 12.0)
    max_climb_mps: float = ranged(0.0, 2.0, 3.0)
    max_descent_mps: float = ranged(0.0, 1.0, 1.5)
    max_yaw_rate_rps: float = ranged(0.0, math.radians(75), math.radians(90))
    max_acceleration_mps2: float = ranged(0.5, 4.0, 5.0)
    max_yaw_acceleration_rps2: float = ranged(0.1, math.radians(150), math.radians(180))
    min_height_m: float = ranged(1.5, 3.0, 120.0)
    max_height_m: float = ranged(1.5, 60.0, 120.0)
    fence_north_m: float = ranged(-10_000.0, 0.0, 10_000.0)
    fence_east_m: float = ranged(-10_000.0, 0.0, 10_000.0)
    fence_radius_m: float = ranged(1.0, 150.0, 500.0)
    response_s: float = ranged(0.5, 0.9, 3.0)  # link and vehicle, for the stopping distance
    braking_mps2: float = ranged(0.2, 2.0, 2.5)
    request_age_s: float = ranged(0.05, 0.2, 0.2)
    telemetry_age_s: float = ranged(0.1, 0.5, 0.5)
    heartbeat_age_s: float = ranged(1.1, 3.0, 3.0)

    def __post_init__(self) -> None:
        for f in fields(self):
            value, low, high = getattr(self, f.name), f.metadata["low"], f.metadata["high"]
            if not finite(value) or not low <= value <= high:
                raise ValueError(f"{f.name} must be from {low:g} to {high:g}, not {value!r}")
        if self.min_height_m >= self.max_height_m:
            raise ValueError(f"min_height_m {self.min_height_m:g} must be below max_height_m")


def stoppable_mps(margin_m: float, limits: Limits) -> float:
    """The speed v whose stopping distance v * response + v² / (2 * braking) is the margin; 0 beyond it."""
    a, t = limits.braking_mps2, limits.response_s
    return a * (math.sqrt(t * t + 2 * max(margin_m, 0.0) / a) - t)


def fresh(t_s: object, now_s: object, age_s: float) -> bool:
    """Whether the stamp is a number, no older than age_s and not from the future."""
    return finite(t_s) and finite(now_s) and -_AHEAD_S <= now_s - t_s <= age_s


def vector(value: object) -> bool:
    """Whether it is a tuple of three finite numbers."""
    return isinstance(value, tuple) and len(value) == 3 and all(map(finite, value))


def finite(value: object) -> TypeGuard[float]:
    """A plain number that arithmetic cannot overflow; NaN, inf, bool, text and None are not."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e9

"""Keeps the distance true while the target turns: a car shows more of itself from the side than from behind.

Size tells quickly how the distance changes, height and depression tell slowly what it is. So the range that
belongs to the confirmed size is led, with a time constant, to what the line of sight to the ground says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from control.config import FollowConfig
from control.follow import distance_m
from control.modes import Confirmation, ground_distance_m
from control.types import TargetState, VehicleState

_TIME_CONSTANT_S = 2.0
_MOST_FACTOR = 1.7  # how far the range may be led away from that of the confirmation
_LEAST_DEPRESSION_FACTOR = 2.0  # times the least depression from which a distance is told at all
_MAX_STEP_S = 0.2


@dataclass(frozen=True, slots=True)
class Ranging:
    """What the moment of confirmation fixed.

    range_m: slant range at the confirmed size. ground_factor: the distance confirmed, over what height and
    depression said of it: 1 unless the operator typed one, whose word on sloping ground is kept.
    """

    range_m: float
    ground_factor: float

    @classmethod
    def begin(
        cls, confirmation: Confirmation, target: TargetState, vehicle: VehicleState, config: FollowConfig
    ) -> Ranging | None:
        """None where the line of sight tells no distance: then size alone must do."""
        ground_m = _ground_m(target, vehicle, config)
        if ground_m is None:
            return None
        return cls(confirmation.range_m, distance_m(confirmation, target) / ground_m)

    def lead(
        self,
        confirmation: Confirmation,
        target: TargetState,
        vehicle: VehicleState,
        dt_s: float,
        config: FollowConfig,
    ) -> Confirmation:
        """The confirmation dt_s (s) later; unchanged while the tracker is unsure or the sight too flat."""
        ground_m = _ground_m(target, vehicle, config)
        if ground_m is None or not target.confidence >= config.full_confidence:
            return confirmation
        error = math.log(self.ground_factor * ground_m / distance_m(confirmation, target))
        step = min(max(dt_s, 0.0), _MAX_STEP_S) / _TIME_CONSTANT_S
        led_m = confirmation.range_m * math.exp(min(max(error, -1.0), 1.0) * step)
        low_m, high_m = self.range_m / _MOST_FACTOR, self.range_m * _MOST_FACTOR
        return replace(confirmation, range_m=min(max(led_m, low_m), high_m))


def _ground_m(target: TargetState, vehicle: VehicleState, config: FollowConfig) -> float | None:
    if -target.elevation_rad < _LEAST_DEPRESSION_FACTOR * config.min_depression_rad:
        return None
    return ground_distance_m(target, vehicle, config)

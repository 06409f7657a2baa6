"""Keeps the distance true while the target turns: a car shows more of itself from the side than from behind.

Size tells quickly how the distance changes, height and depression tell slowly what it is. So the range that
belongs to the confirmed size is led, with a time constant, to what the line of sight to the ground says.
"""

from __future__ import annotations

import math
from dataclasses import replace

from control.config import FollowConfig
from control.modes import Confirmation, sure_ground_m
from control.motion import distance_m
from control.types import TargetState, VehicleState

_TIME_CONSTANT_S = 2.0
_MOST_FACTOR = 1.7  # how far the range may be led away from that of the confirmation
_MAX_STEP_S = 0.2


def lead_range(
    confirmation: Confirmation, target: TargetState, vehicle: VehicleState, dt_s: float, config: FollowConfig
) -> Confirmation:
    """The confirmation dt_s (s) later; unchanged while the tracker is unsure or the sight too flat."""
    ground_m, factor = sure_ground_m(target, vehicle, config), confirmation.ground_factor
    if ground_m is None or factor is None or not target.confidence >= config.full_confidence:
        return confirmation
    error = math.log(factor * ground_m / distance_m(confirmation, target))
    step = min(max(dt_s, 0.0), _MAX_STEP_S) / _TIME_CONSTANT_S
    led_m = confirmation.range_m * math.exp(min(max(error, -1.0), 1.0) * step)
    low_m, high_m = confirmation.confirmed_range_m / _MOST_FACTOR, confirmation.confirmed_range_m * _MOST_FACTOR
    return replace(confirmation, range_m=min(max(led_m, low_m), high_m))

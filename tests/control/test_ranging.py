"""The distance of a target that turns, from what size and line of sight say."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from control.config import FollowConfig
from control.modes import Confirmation, FollowMode, confirm
from control.motion import distance_m
from control.ranging import lead_range
from control.types import TargetState, VehicleState

CONFIG = FollowConfig()
VEHICLE = VehicleState(height_m=9.0)


def target(distance: float, log_size: float, confidence: float = 0.9, height_m: float = 9.0) -> TargetState:
    """Standing on the ground straight ahead."""
    elevation = -math.atan2(height_m, distance)
    return TargetState(0.0, 0.0, 0.0, elevation, 0.0, log_size, 0.0, 0.01, 0.01, 0.02, confidence, 0.0, 0)


def begun(distance: float = 18.0, typed: float | None = None) -> Confirmation:
    seen = target(distance, -2.0)
    return confirm(FollowMode.FOLLOW, seen, VEHICLE, 0.0, CONFIG, distance_m=typed)


def led(confirmation: Confirmation, seen: TargetState, seconds: float) -> Confirmation:
    for _ in range(round(seconds / 0.05)):
        confirmation = lead_range(confirmation, seen, VEHICLE, 0.05, CONFIG)
    return confirmation


def test_a_target_that_turns_its_side_keeps_its_distance() -> None:
    confirmation = begun()
    side_on = target(18.0, -2.0 + math.log(1.4))
    assert distance_m(confirmation, side_on) == pytest.approx(18.0 / 1.4)  # what size alone would say
    after = led(confirmation, side_on, 2.0)
    assert math.log(18.0 / distance_m(after, side_on)) == pytest.approx(math.log(1.4) / math.e, rel=0.02)
    assert distance_m(led(after, side_on, 10.0), side_on) == pytest.approx(18.0, rel=0.01)


def test_nothing_changes_while_size_and_sight_agree() -> None:
    confirmation = begun()
    closer = target(12.0, -2.0 + math.log(math.hypot(18, 9) / math.hypot(12, 9)))
    assert led(confirmation, closer, 5.0).range_m == pytest.approx(confirmation.range_m, rel=1e-9)


def test_a_typed_distance_stays_the_operators() -> None:
    confirmation = begun(typed=25.0)
    assert distance_m(led(confirmation, target(18.0, -2.0), 5.0), target(18.0, -2.0)) == pytest.approx(25.0)


def test_an_unsure_tracker_leads_nothing() -> None:
    confirmation = begun()
    assert led(confirmation, target(18.0, -1.5, confidence=0.5), 5.0) == confirmation


def test_the_range_is_led_only_so_far() -> None:
    confirmation = begun()
    after = led(confirmation, target(79.0, -2.0), 60.0)  # depression still enough at 9 m? flat: no lead
    assert after == confirmation
    after = led(confirmation, target(40.0, -0.5), 60.0)
    assert after.range_m == pytest.approx(1.7 * confirmation.range_m)


def test_a_flat_sight_leads_nothing() -> None:
    seen = target(79.0, -2.0)
    confirmation = confirm(FollowMode.FOLLOW, seen, VEHICLE, 0.0, CONFIG)
    assert confirmation.ground_factor is None
    assert led(confirmation, target(18.0, -2.0), 5.0) == confirmation
    sure = confirm(FollowMode.FOLLOW, target(18.0, -2.0), VEHICLE, 0.0, CONFIG)
    assert sure.ground_factor == pytest.approx(1.0)
    on_the_ground = replace(VEHICLE, height_m=-1.0)
    assert lead_range(sure, target(18.0, -1.8), on_the_ground, 0.05, CONFIG) == sure

"""Shaping: acceleration, jerk, slope of the yaw rate, and the picture."""

import itertools
import math
from dataclasses import replace

import pytest

from control.config import ShapingConfig
from control.limits import ShapeState, Wish, after_setpoint, priming_request, shape, zero_request

SHAPING = ShapingConfig()


@pytest.mark.parametrize("brake", [False, True])
@pytest.mark.parametrize("aim", [(3.0, 0.0, 0.0), (0.2, -0.1, 0.05), (-5.0, 4.0, 1.0), (1e-3, 0.0, 0.0)])
def test_shaping_arrives_within_acceleration_and_jerk(aim, brake):
    state, now, before = ShapeState(0.0), 0.0, (0.0, 0.0, 0.0)
    top = SHAPING.braking_mps2 if brake else SHAPING.acceleration_mps2
    jerk = SHAPING.braking_jerk_mps3 if brake else SHAPING.jerk_mps3
    peak = 0.0
    for _ in range(120):
        now += 0.05
        _, state, names = shape(state, Wish(aim, 0.0, brake=brake), now, SHAPING)
        acceleration = tuple((b - a) / 0.05 for a, b in zip(before, state.velocity_ned_mps, strict=True))
        assert math.hypot(*acceleration) <= top + 1e-6
        before = state.velocity_ned_mps
        peak = max(peak, math.hypot(*before))
    assert state.velocity_ned_mps == pytest.approx(aim, abs=1e-6)
    assert peak <= math.hypot(*aim) * 1.1 + 0.02
    assert names == ()
    assert jerk > 0


def test_jerk_is_bounded_on_the_way_up():
    state, accelerations = ShapeState(0.0), [0.0]
    for n in range(10):
        _, state, names = shape(state, Wish((6.0, 0.0, 0.0), 0.0), 0.05 * (n + 1), SHAPING)
        accelerations.append(state.acceleration_ned_mps2[0])
    steps = [b - a for a, b in itertools.pairwise(accelerations)]
    assert max(steps) <= SHAPING.jerk_mps3 * 0.05 + 1e-9
    assert "acceleration" in names


def test_the_slope_of_the_yaw_rate_is_bounded_and_named():
    request, state, names = shape(ShapeState(0.0), Wish((0.0, 0.0, 0.0), 1.0), 0.05, SHAPING)
    assert request.yaw_rate_rps == pytest.approx(SHAPING.yaw_slope_rps2 * 0.05)
    assert "yaw rate slope" in names
    assert request.limited_by == names
    back, _, _ = shape(state, Wish((0.0, 0.0, 0.0), -1.0), 0.1, SHAPING)
    assert back.yaw_rate_rps == pytest.approx(0.0)


def test_the_picture_bounds_acceleration_along_the_sight_only():
    tight = Wish((5.0, 5.0, 0.0), 0.0, sight_ne=(1.0, 0.0), sight_acceleration_mps2=(-0.5, 0.5))
    state = ShapeState(0.0)
    for n in range(10):
        _, state, names = shape(state, tight, 0.05 * (n + 1), SHAPING)
    assert state.acceleration_ned_mps2[0] == pytest.approx(0.5)
    assert state.acceleration_ned_mps2[1] > 1.0
    assert "field of view" in names
    braking = replace(tight, brake=True)
    for n in range(10):
        _, state, names = shape(state, braking, 0.55 + 0.05 * n, SHAPING)
    assert state.acceleration_ned_mps2[0] > 1.0


def test_after_a_gap_shaping_starts_from_rest_and_a_repeated_tick_changes_nothing():
    moving = ShapeState(0.0, (5.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0)
    request, _, _ = shape(moving, Wish((5.0, 0.0, 0.0), 1.0), 1.0, SHAPING)
    assert request.velocity_ned_mps[0] < 0.1
    assert request.yaw_rate_rps == pytest.approx(SHAPING.yaw_slope_rps2 * 0.05)
    request, _, _ = shape(moving, Wish((9.0, 0.0, 0.0), 1.0), 0.0, SHAPING)
    assert request.velocity_ned_mps == (5.0, 0.0, 0.0)


def test_shaping_goes_on_from_what_the_gate_really_sent():
    state = ShapeState(1.0, (2.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.5)
    assert after_setpoint(state, (2.0, 0.0, 0.0), 0.5) is state
    trimmed = after_setpoint(state, (0.0, 0.0, 0.0), 0.0)
    assert trimmed == ShapeState(1.0)


def test_zero_and_priming_requests():
    assert zero_request(3.0).velocity_ned_mps == (0.0, 0.0, 0.0)
    assert not zero_request(3.0).priming
    assert priming_request(3.0).priming

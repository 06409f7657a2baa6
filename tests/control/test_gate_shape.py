"""What the gate leaves of a velocity: speed, height and acceleration."""

import math
from dataclasses import replace

import pytest

from control.gate import Limits, Reason, gate
from tests.control.gate_rig import HEALTHY, LIMITS, NOW, replace_time, request, settle


def test_speed_climb_descent_and_yaw_rate_are_clipped():
    setpoint, reason = settle((30.0, 40.0, 0.0), 9.0)
    assert math.hypot(*setpoint.velocity_ned_mps[:2]) == pytest.approx(LIMITS.max_speed_mps)
    assert setpoint.velocity_ned_mps[1] / setpoint.velocity_ned_mps[0] == pytest.approx(4 / 3)
    assert setpoint.yaw_rate_rps == pytest.approx(LIMITS.max_yaw_rate_rps)
    assert reason is Reason.SPEED
    assert settle((0.0, 0.0, -9.0))[0].velocity_ned_mps[2] == pytest.approx(-LIMITS.max_climb_mps)
    assert settle((0.0, 0.0, 9.0), -9.0)[0].velocity_ned_mps[2] == pytest.approx(LIMITS.max_descent_mps)
    assert settle((0.0, 0.0, 9.0), -9.0)[0].yaw_rate_rps == pytest.approx(-LIMITS.max_yaw_rate_rps)


def test_velocity_and_yaw_rate_change_no_faster_than_the_limits():
    setpoint, reason = gate(request((4.0, 3.0, 0.0), -1.0), HEALTHY, NOW, None, LIMITS)
    assert reason is Reason.SLEW
    assert setpoint.velocity_ned_mps == pytest.approx((0.16, 0.12, 0.0))
    assert setpoint.yaw_rate_rps == pytest.approx(-LIMITS.max_yaw_acceleration_rps2 * 0.05)


def test_a_long_tick_buys_at_most_two_ticks_of_change():
    first, _ = gate(request(), HEALTHY, NOW, None, LIMITS)
    late = NOW + 0.19
    second, _ = gate(request((5.0, 0.0, 0.0), t_s=late), HEALTHY, late, first, LIMITS)
    assert second.velocity_ned_mps[0] == pytest.approx(0.1 + 4.0 * 0.1)


@pytest.mark.parametrize(
    ("height", "asked", "allowed"),
    [(3.0, 1.0, 0.0), (2.0, 1.0, 0.0), (60.0, -1.0, 0.0), (2.0, -0.5, -0.5), (61.0, 0.5, 0.5)],
)
def test_floor_and_ceiling_stop_only_the_wrong_direction(height, asked, allowed):
    setpoint, reason = settle((0.0, 0.0, asked), vehicle=replace(HEALTHY, height_m=height))
    assert setpoint.velocity_ned_mps[2] == pytest.approx(allowed)
    assert reason is (Reason.PASSED if asked == allowed else Reason.ALTITUDE)


@pytest.mark.parametrize(("height", "sign"), [(3.5, 1), (59.5, -1)])
def test_near_floor_and_ceiling_the_speed_is_what_can_be_stopped(height, sign):
    setpoint, reason = settle((0.0, 0.0, 2.0 * sign), vehicle=replace(HEALTHY, height_m=height))
    v = setpoint.velocity_ned_mps[2] * sign
    assert v * LIMITS.response_s + v**2 / (2 * LIMITS.braking_mps2) == pytest.approx(0.5)
    assert reason is Reason.ALTITUDE


@pytest.mark.parametrize("height", [3.0, 60.0])
def test_level_flight_at_floor_and_ceiling_is_not_a_trim(height):
    assert settle((1.0, 0.0, 0.0), vehicle=replace(HEALTHY, height_m=height))[1] is Reason.PASSED


def test_limits_that_tighten_in_flight_are_reached_by_slewing():
    flying, _ = settle((0.0, 0.0, 0.0), 1.2)
    tighter = Limits(max_yaw_rate_rps=1.1)
    setpoint, _ = gate(request((0.0, 0.0, 0.0), -1.0), HEALTHY, NOW, replace_time(flying), tighter)
    assert setpoint.yaw_rate_rps == pytest.approx(1.2 - LIMITS.max_yaw_acceleration_rps2 * 0.05)


def test_a_slow_limit_is_a_limit_too():
    slow = Limits(max_speed_mps=0.5)
    assert settle((0.8, 0.0, 0.0), limits=slow)[0].velocity_ned_mps == pytest.approx((0.5, 0.0, 0.0))


def test_at_the_same_moment_nothing_changes():
    flying, _ = settle((2.0, 0.0, 0.0), 0.5)
    again = replace_time(flying, NOW)
    setpoint, reason = gate(request((3.0, 0.0, 0.0), 0.9), HEALTHY, NOW, again, LIMITS)
    assert setpoint.velocity_ned_mps == pytest.approx(flying.velocity_ned_mps)
    assert setpoint.yaw_rate_rps == pytest.approx(flying.yaw_rate_rps)
    assert reason is Reason.SLEW

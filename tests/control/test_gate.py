"""The gate, case by case; what holds for any input is in tests/property."""

import math
from dataclasses import FrozenInstanceError, fields, replace

import pytest

from control import gate as gate_module
from control.gate import Limits, Reason, Setpoint, gate
from control.types import VehicleMode, VehicleState, VelocityRequest

NOW = 100.0
LIMITS = Limits()
HEALTHY = VehicleState(
    heartbeat_t_s=NOW, mode=VehicleMode.EXTERNAL, mode_t_s=NOW, armed=True, in_air=True,
    attitude_t_s=NOW, position_t_s=NOW, height_m=20.0,
)  # fmt: skip


def request(velocity=(0.1, 0.0, 0.0), yaw_rate=0.0, t_s=NOW, **kwargs):
    return VelocityRequest(t_s, velocity, yaw_rate, **kwargs)


def settle(velocity, yaw_rate=0.0, vehicle=HEALTHY, limits=LIMITS):
    """The setpoint and reason after the gate has seen the same request for ten seconds."""
    setpoint, reason, now = None, None, NOW
    for _ in range(200):
        now += 0.05
        fresh = replace(vehicle, heartbeat_t_s=now, mode_t_s=now, attitude_t_s=now, position_t_s=now)
        setpoint, reason = gate(request(velocity, yaw_rate, now), fresh, now, setpoint, limits)
    return setpoint, reason


def test_a_healthy_small_request_passes_unchanged():
    setpoint, reason = gate(request((0.1, -0.05, 0.02), 0.05), HEALTHY, NOW, None, LIMITS)
    assert reason is Reason.PASSED
    assert (setpoint.velocity_ned_mps, setpoint.yaw_rate_rps, setpoint.t_s) == ((0.1, -0.05, 0.02), 0.05, NOW)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"mode": VehicleMode.HOLD}, Reason.NOT_OURS),
        ({"mode": VehicleMode.MANUAL}, Reason.NOT_OURS),
        ({"mode": VehicleMode.UNKNOWN}, Reason.NOT_OURS),
        ({"mode": "external"}, Reason.NOT_OURS),
        ({"armed": False}, Reason.NOT_ARMED),
        ({"armed": "yes"}, Reason.NOT_ARMED),
        ({"failsafe": True}, Reason.FAILSAFE),
        ({"failsafe": None}, Reason.FAILSAFE),
        ({"heartbeat_t_s": None}, Reason.HEARTBEAT_STALE),
        ({"heartbeat_t_s": NOW - 3.01}, Reason.HEARTBEAT_STALE),
        ({"heartbeat_t_s": NOW + 0.06}, Reason.HEARTBEAT_STALE),
        ({"mode_t_s": NOW - 3.01}, Reason.HEARTBEAT_STALE),
        ({"mode_t_s": math.nan}, Reason.HEARTBEAT_STALE),
    ],
)
def test_nothing_is_sent_where_the_vehicle_is_not_known_to_be_ours(change, reason):
    assert gate(request(), replace(HEALTHY, **change), NOW, None, LIMITS) == (None, reason)


@pytest.mark.parametrize("age", [2.99, 0.0, -0.05])
def test_a_heartbeat_within_its_age_is_believed(age):
    assert gate(request(), replace(HEALTHY, heartbeat_t_s=NOW - age), NOW, None, LIMITS)[0] is not None


@pytest.mark.parametrize(
    ("change", "vehicle_change", "reason"),
    [
        ({"t_s": NOW - 0.21}, {}, Reason.REQUEST_STALE),
        ({"t_s": NOW + 0.06}, {}, Reason.REQUEST_STALE),
        ({"t_s": None}, {}, Reason.REQUEST_STALE),
        ({"velocity_ned_mps": (math.nan, 0.0, 0.0)}, {}, Reason.REQUEST_INVALID),
        ({"velocity_ned_mps": (0.0, math.inf, 0.0)}, {}, Reason.REQUEST_INVALID),
        ({"velocity_ned_mps": (0.0, 0.0)}, {}, Reason.REQUEST_INVALID),
        ({"velocity_ned_mps": None}, {}, Reason.REQUEST_INVALID),
        ({"velocity_ned_mps": ("1", 0.0, 0.0)}, {}, Reason.REQUEST_INVALID),
        ({"velocity_ned_mps": (True, 0.0, 0.0)}, {}, Reason.REQUEST_INVALID),
        ({"velocity_ned_mps": (10**400, 0.0, 0.0)}, {}, Reason.REQUEST_INVALID),
        ({"yaw_rate_rps": math.nan}, {}, Reason.REQUEST_INVALID),
        ({}, {"attitude_t_s": NOW - 0.51}, Reason.TELEMETRY_STALE),
        ({}, {"position_t_s": NOW - 0.51}, Reason.TELEMETRY_STALE),
        ({}, {"position_t_s": None}, Reason.TELEMETRY_STALE),
        ({}, {"position_ned_m": (math.nan, 0.0, 0.0)}, Reason.TELEMETRY_STALE),
        ({}, {"height_m": math.nan}, Reason.TELEMETRY_STALE),
    ],
)
def test_zero_goes_out_at_once_where_flying_on_would_be_blind(change, vehicle_change, reason):
    flying, _ = settle((2.0, 0.0, 0.0), 0.3)
    before = replace_time(flying)
    setpoint, why = gate(
        replace(request((2.0, 0.0, 0.0), 0.3), **change), replace(HEALTHY, **vehicle_change), NOW, before, LIMITS
    )
    assert why is reason
    assert (setpoint.velocity_ned_mps, setpoint.yaw_rate_rps) == ((0.0, 0.0, 0.0), 0.0)


def replace_time(setpoint, t_s=NOW - 0.05):
    """The same setpoint as if sent one tick ago; the token shows that tests must break in to do so."""
    return Setpoint(t_s, setpoint.velocity_ned_mps, setpoint.yaw_rate_rps, gate_module._TOKEN)


@pytest.mark.parametrize(("age", "kept"), [(0.19, True), (0.21, False)])
def test_request_age_is_bounded_by_200_ms(age, kept):
    setpoint, _ = gate(request(t_s=NOW - age), HEALTHY, NOW, None, LIMITS)
    assert any(setpoint.velocity_ned_mps) is kept


def test_after_a_gap_of_our_own_the_first_setpoint_is_zero():
    flying, _ = settle((2.0, 0.0, 0.0))
    before = replace_time(flying, NOW - 0.25)
    setpoint, reason = gate(request((2.0, 0.0, 0.0)), HEALTHY, NOW, before, LIMITS)
    assert reason is Reason.GAP
    assert setpoint.velocity_ned_mps == (0.0, 0.0, 0.0)


def test_a_deliberate_stop_takes_one_tick():
    flying, _ = settle((5.0, 1.0, 0.5), 1.0)
    setpoint, reason = gate(request((0.0, 0.0, 0.0)), HEALTHY, NOW, replace_time(flying), LIMITS)
    assert reason is Reason.PASSED
    assert (setpoint.velocity_ned_mps, setpoint.yaw_rate_rps) == ((0.0, 0.0, 0.0), 0.0)


def test_priming_is_zero_and_only_in_hold():
    eager = request((3.0, 0.0, 0.0), 1.0, priming=True)
    setpoint, reason = gate(eager, replace(HEALTHY, mode=VehicleMode.HOLD), NOW, None, LIMITS)
    assert reason is Reason.PRIMING
    assert (setpoint.velocity_ned_mps, setpoint.yaw_rate_rps) == ((0.0, 0.0, 0.0), 0.0)
    for mode in set(VehicleMode) - {VehicleMode.HOLD, VehicleMode.EXTERNAL}:
        assert gate(eager, replace(HEALTHY, mode=mode), NOW, None, LIMITS) == (None, Reason.NOT_OURS)
    assert gate(eager, HEALTHY, NOW, None, LIMITS)[1] is Reason.PRIMING


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        ((None, HEALTHY, NOW, None, LIMITS), Reason.NO_REQUEST),
        (("go", HEALTHY, NOW, None, LIMITS), Reason.NO_REQUEST),
        ((request(), None, NOW, None, LIMITS), Reason.BAD_CALL),
        ((request(), HEALTHY, math.nan, None, LIMITS), Reason.BAD_CALL),
        ((request(), HEALTHY, None, None, LIMITS), Reason.BAD_CALL),
        ((request(), HEALTHY, NOW, None, None), Reason.BAD_CALL),
    ],
)
def test_unusable_arguments_send_nothing(bad, reason):
    assert gate(*bad) == (None, reason)


def test_a_previous_that_is_no_setpoint_counts_as_rest():
    setpoint, reason = gate(request((5.0, 0.0, 0.0)), HEALTHY, NOW, "something", LIMITS)
    assert reason is Reason.SLEW
    assert setpoint.velocity_ned_mps[0] == pytest.approx(4.0 * 0.05)


def test_only_the_gate_makes_a_setpoint():
    with pytest.raises(TypeError, match="only control"):
        Setpoint(NOW, (1.0, 0.0, 0.0), 0.0, object())
    made, _ = gate(request(), HEALTHY, NOW, None, LIMITS)
    with pytest.raises((TypeError, ValueError)):
        replace(made, velocity_ned_mps=(9.0, 0.0, 0.0))
    with pytest.raises(FrozenInstanceError):
        made.yaw_rate_rps = 9.0


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


def test_along_the_fence_is_not_a_trim():
    at_fence = replace(HEALTHY, position_ned_m=(150.0, 0.0, -20.0))
    assert settle((0.0, 1.0, 0.0), vehicle=at_fence)[1] is Reason.PASSED


def test_the_fence_is_round():
    corner = replace(HEALTHY, position_ned_m=(-90.0, 120.0, -20.0))
    setpoint, _ = settle((0.0, 2.5, 0.0), vehicle=corner)
    assert setpoint.velocity_ned_mps == pytest.approx((1.2, 0.9, 0.0))


def test_limits_that_tighten_in_flight_are_reached_by_slewing():
    flying, _ = settle((0.0, 0.0, 0.0), 1.2)
    tighter = Limits(max_yaw_rate_rps=1.1)
    setpoint, _ = gate(request((0.0, 0.0, 0.0), -1.0), HEALTHY, NOW, replace_time(flying), tighter)
    assert setpoint.yaw_rate_rps == pytest.approx(1.2 - LIMITS.max_yaw_acceleration_rps2 * 0.05)


def test_the_fence_takes_away_only_the_outward_part():
    at_fence = replace(HEALTHY, position_ned_m=(150.0, 0.0, -20.0))
    setpoint, reason = settle((2.0, 1.0, 0.0), vehicle=at_fence)
    assert setpoint.velocity_ned_mps == pytest.approx((0.0, 1.0, 0.0))
    assert reason is Reason.FENCE
    assert settle((-2.0, 0.0, 0.0), vehicle=at_fence)[0].velocity_ned_mps[0] == pytest.approx(-2.0)


def test_the_fence_has_a_centre():
    limits = Limits(fence_north_m=100.0, fence_east_m=-50.0, fence_radius_m=20.0)
    beyond = replace(HEALTHY, position_ned_m=(100.0, -75.0, -20.0))
    assert settle((0.0, -1.0, 0.0), vehicle=beyond, limits=limits)[0].velocity_ned_mps[1] == 0.0
    middle = replace(HEALTHY, position_ned_m=(100.0, -50.0, -20.0))
    assert settle((0.0, -1.0, 0.0), vehicle=middle, limits=limits)[0].velocity_ned_mps[1] == -1.0


def test_a_limit_that_jumps_stops_the_vehicle():
    flying, _ = settle((5.0, 0.0, 0.0))
    outside = replace(HEALTHY, position_ned_m=(160.0, 0.0, -20.0))
    setpoint, reason = gate(request((5.0, 1.0, 0.0)), outside, NOW, replace_time(flying), LIMITS)
    assert (setpoint.velocity_ned_mps, reason) == ((0.0, 0.0, 0.0), Reason.LIMIT_JUMPED)


def test_a_fence_that_closes_slowly_is_paid_for_out_of_the_slew():
    before, _ = settle((3.0, 0.0, 0.0))
    near = replace(HEALTHY, position_ned_m=(150.0 - 4.9, 0.0, -20.0))
    setpoint, _ = gate(request((3.0, 3.0, 0.0)), near, NOW, replace_time(before), LIMITS)
    assert any(setpoint.velocity_ned_mps)
    assert math.dist(setpoint.velocity_ned_mps, before.velocity_ned_mps) <= 4.0 * 0.05 + 1e-9
    assert setpoint.velocity_ned_mps[0] < 3.0


@pytest.mark.parametrize("gust_mps", [0.0, 1.0])
def test_flying_at_the_fence_stays_within_a_metre(gust_mps):
    """PX4's measured response; the gust is a push outward that the vehicle's own loop takes back."""
    limits = Limits(fence_radius_m=40.0)
    north, speed, setpoint, now, line = 0.0, 0.0, None, NOW, [0.0] * 20
    furthest = 0.0
    for _ in range(600):
        now += 0.05
        state = replace(
            HEALTHY, heartbeat_t_s=now, mode_t_s=now, attitude_t_s=now, position_t_s=now,
            position_ned_m=(north, 0.0, -20.0),
        )  # fmt: skip
        setpoint, _ = gate(request((8.0, 0.0, 0.0), t_s=now), state, now, setpoint, limits)
        for _ in range(5):
            line.append(setpoint.velocity_ned_mps[0])
            speed += (line.pop(0) - speed) * 0.01 / 0.48
            north += speed * 0.01
        if north > 38.0:
            speed, gust_mps = speed + gust_mps, 0.0
        furthest = max(furthest, north)
    assert 38.0 < furthest < 41.0


@pytest.mark.parametrize("name", [f.name for f in fields(Limits)])
def test_configuration_can_only_tighten_the_ceilings(name):
    field = next(f for f in fields(Limits) if f.name == name)
    for bad in (field.metadata["low"] - 0.01, field.metadata["high"] + 0.01, math.nan, math.inf, None, "3", True):
        with pytest.raises(ValueError, match=name):
            Limits(**{name: bad})
    assert field.metadata["low"] <= getattr(Limits(), name) <= field.metadata["high"]


def test_floor_above_ceiling_is_refused():
    with pytest.raises(ValueError, match="min_height_m 50 must be below"):
        Limits(min_height_m=50.0, max_height_m=40.0)

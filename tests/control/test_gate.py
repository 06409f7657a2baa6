"""When the gate lets out nothing or zero, case by case; what holds for any input is in tests/property."""

import math
from dataclasses import FrozenInstanceError, replace

import pytest

from control.gate import Reason, Setpoint, gate
from control.types import VehicleMode
from tests.control.gate_rig import HEALTHY, LIMITS, NOW, replace_time, request, settle


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

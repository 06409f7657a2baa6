"""Each time limit to the last representable bit: at it, and one tick after it. Clocks begin so that 0.0 is exact."""

import math

import pytest

from control.config import EngagementConfig
from control.engagement import Action, Cause, Engagement, State
from control.preflight import conditions, link_ok, refusals, target_seen, telemetry_ok, video_ok
from control.types import VehicleMode

from .engagement_story import CONFIG, healthy

HOLD, EXTERNAL = VehicleMode.HOLD, VehicleMode.EXTERNAL


def lived(*ticks):
    """A machine after these ticks of (time, mode, changes), and the last output."""
    machine, out = Engagement(CONFIG), None
    for now, mode, changes in ticks:
        out = machine.update(now, healthy(now, mode, **changes))
    return machine, out


def following_since_zero():
    """Confirmed at -0.05; FOLLOWING and the target measured at 0.0 exactly."""
    machine, out = lived((-0.1, HOLD, {}), (-0.05, HOLD, {"confirm": True}), (0.0, EXTERNAL, {}))
    assert out.state is State.FOLLOWING
    return machine


def go_on(machine, until, mode=EXTERNAL, step=0.125, **changes):
    """Ticks up to `until`, which is one of them; the last output."""
    now, out = 0.0, None
    while now < until:
        now = min(now + step, until)
        out = machine.update(now, healthy(now, mode, **changes))
    return out


def test_a_tick_of_just_the_longest_gap_is_none():
    assert following_since_zero().update(0.2, healthy(0.2)).state is State.FOLLOWING
    machine = following_since_zero()
    assert machine.update(math.nextafter(0.2, 1.0), healthy(0.2)).state is State.RELEASED


def test_requests_may_stall_for_exactly_a_second():
    machine = following_since_zero()
    assert go_on(machine, 1.0, request_t_s=None).state is State.FOLLOWING
    assert machine.update(1.001, healthy(1.001, request_t_s=None)).state is State.RELEASED


def test_the_mode_is_waited_for_exactly_that_long():
    machine, out = lived((-0.05, HOLD, {}), (0.0, HOLD, {"confirm": True}))
    assert out.engaging
    assert go_on(machine, 1.5, HOLD).action is Action.ENGAGE
    assert machine.update(1.501, healthy(1.501, HOLD)).state is State.RELEASED


def test_an_unseen_target_stops_us_at_exactly_a_second_and_ends_the_follow_after_exactly_three():
    machine = following_since_zero()
    out = go_on(machine, 1.0, measured_t_s=0.0)
    assert (out.state, out.action, out.velocity_factor) == (State.LOST_HOLD, Action.SEND_ZERO, 0.0)
    machine = following_since_zero()
    assert go_on(machine, 3.0, measured_t_s=0.0).state is State.LOST_HOLD
    assert machine.update(3.001, healthy(3.001, measured_t_s=0.0)).state is State.RELEASED


@pytest.mark.parametrize(("mode", "seconds"), [(EXTERNAL, 2.0), (HOLD, 0.5)])
def test_hold_is_commanded_up_to_exactly_its_time(mode, seconds):
    machine, out = lived((-0.1, HOLD, {}), (-0.05, HOLD, {"confirm": True}), (0.0, EXTERNAL, {"abort": True}))
    assert out.action is Action.COMMAND_HOLD
    assert go_on(machine, seconds, mode).action is Action.COMMAND_HOLD
    assert machine.update(seconds + 0.001, healthy(seconds + 0.001, mode)).action is Action.SILENCE


def test_hold_is_commanded_only_once_where_the_mode_is_not_heard():
    machine, out = lived((-0.1, HOLD, {}), (-0.05, HOLD, {"confirm": True}), (0.0, EXTERNAL, {"abort": True}))
    out = go_on(machine, 1.0, mode_t_s=0.0)
    assert out.action is Action.COMMAND_HOLD
    out = machine.update(1.001, healthy(1.001, EXTERNAL, mode_t_s=0.0))
    assert (out.action, out.reasons) == (Action.SILENCE, (Cause.ABORT,))
    assert machine.update(1.3, healthy(1.3, EXTERNAL)).action is Action.SILENCE  # heard again: not ours any more
    machine = following_since_zero()
    lost = machine.update(0.05, healthy(0.05, mode_t_s=-3.0, heartbeat_t_s=-3.0))
    assert (lost.action, lost.reasons) == (Action.COMMAND_HOLD, (Cause.LINK_LOST,))
    lost = machine.update(0.1, healthy(0.1, mode_t_s=-3.0, heartbeat_t_s=-3.0))
    assert (lost.action, lost.reasons) == (Action.SILENCE, (Cause.LINK_LOST,))


def test_what_is_as_old_as_allowed_is_fresh():
    age = CONFIG.target_age_s
    assert video_ok(healthy(age, frame_t_s=0.0), age, CONFIG)
    assert not video_ok(healthy(age, frame_t_s=-0.001), age, CONFIG)
    assert target_seen(healthy(age, measured_t_s=0.0), age, CONFIG)
    assert not target_seen(healthy(age, measured_t_s=-0.001), age, CONFIG)
    assert not target_seen(healthy(age, rejections_in_a_row=CONFIG.max_rejections), age, CONFIG)
    assert target_seen(healthy(age, rejections_in_a_row=CONFIG.max_rejections - 1), age, CONFIG)
    for name in ("heartbeat_t_s", "mode_t_s"):
        assert link_ok(healthy(3.0, **{name: 0.0}), 3.0, CONFIG)
        assert not link_ok(healthy(3.0, **{name: -0.001}), 3.0, CONFIG)
    for name in ("attitude_t_s", "position_t_s"):
        assert telemetry_ok(healthy(0.5, **{name: 0.0}), 0.5, CONFIG)
        assert not telemetry_ok(healthy(0.5, **{name: -0.001}), 0.5, CONFIG)


@pytest.mark.parametrize(
    "change",
    [
        {"latency_s": CONFIG.max_latency_s},
        {"latency_s": 0.0},
        {"confidence": CONFIG.confirm_confidence},
        {"attitude_rate_hz": CONFIG.min_attitude_rate_hz},
        {"height_m": CONFIG.min_height_m},
        {"battery_frac": CONFIG.min_battery_frac},
        {"late_t_s": -0.001 - CONFIG.lag_quiet_s},
    ],
)
def test_what_is_just_enough_does_not_refuse(change):
    assert refusals(healthy(0.0, **change), 0.0, CONFIG) == ()
    assert conditions(healthy(0.0, **change), 0.0, CONFIG) == ()


def test_a_machine_without_a_configuration_has_the_defaults():
    machine, given = Engagement(), Engagement(EngagementConfig())
    for each in (machine, given):
        out = each.update(0.0, healthy(0.0, frame_t_s=None, selected=False))
        assert (out.state, out.reasons, out.action) == (State.NO_VIDEO, (), Action.NONE)

"""The state machine's story, tick by tick."""

import math

import pytest

from control.config import EngagementConfig
from control.engagement import Action, Cause, Engagement, State
from control.preflight import refusals
from control.types import VehicleMode

from .engagement_story import CONFIG, TICK, Story, healthy


def test_selecting_moves_nothing_and_confirming_starts():
    story = Story()
    assert story.tick(VehicleMode.HOLD, frame_t_s=None, selected=False).state is State.NO_VIDEO
    assert story.tick(VehicleMode.HOLD, selected=False).state is State.IDLE
    selected = story.tick(VehicleMode.HOLD, select=True)
    assert (selected.state, selected.action) == (State.SELECTED, Action.NONE)
    for out in story.ticks(100, mode=VehicleMode.HOLD):
        assert (out.state, out.action, out.velocity_factor) == (State.SELECTED, Action.NONE, 0.0)
    confirmed = story.tick(VehicleMode.HOLD, confirm=True)
    assert (confirmed.state, confirmed.action, confirmed.engaging) == (State.SELECTED, Action.ENGAGE, True)
    following = story.tick()
    assert (following.state, following.action, following.velocity_factor) == (
        State.FOLLOWING, Action.SEND_REQUEST, 1.0,
    )  # fmt: skip


def test_a_vehicle_already_in_external_control_follows_at_once():
    story = Story()
    story.tick()
    assert story.tick(confirm=True).state is State.FOLLOWING


def test_a_refusal_lists_every_reason():
    story = Story()
    out = story.tick(
        VehicleMode.MANUAL, confirm=True, selected=False, frame_t_s=None, measured_t_s=None, confidence=0.1,
        distance_known=False, latency_s=0.5, attitude_rate_hz=3.0, heartbeat_t_s=None, attitude_t_s=None, armed=False,
        in_air=False, height_m=1.0, failsafe=True, battery_frac=0.2, outside_fence=True, audit_ok=False,
        late_t_s=story.now, camera_wrong=True, echo_lost=True, foreign_setpoints=True,
    )  # fmt: skip
    assert out.action is Action.NONE
    assert list(out.reasons) == list(Cause)[: list(Cause).index(Cause.ACKNOWLEDGE)]


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ({"selected": False}, Cause.NOT_SELECTED),
        ({"measured_t_s": None}, Cause.NO_TARGET),
        ({"rejections_in_a_row": 5}, Cause.NO_TARGET),
        ({"confidence": 0.49}, Cause.LOW_CONFIDENCE),
        ({"distance_known": False}, Cause.NO_DISTANCE),
        ({"attitude_rate_hz": 3.9}, Cause.ATTITUDE_SLOW),
        ({"mode_t_s": None}, Cause.LINK_LOST),
        ({"position_t_s": 0.0}, Cause.TELEMETRY_STALE),
        ({"armed": False}, Cause.NOT_ARMED),
        ({"in_air": False}, Cause.NOT_IN_AIR),
        ({"height_m": 2.9}, Cause.TOO_LOW),
        ({"failsafe": True}, Cause.FAILSAFE),
        ({"battery_frac": 0.29}, Cause.BATTERY),
        ({"outside_fence": True}, Cause.OUTSIDE_FENCE),
        ({"audit_ok": False}, Cause.AUDIT),
        ({"late_t_s": 100.0}, Cause.OWN_LAG),
        ({"camera_wrong": True}, Cause.CAMERA_WRONG),
        ({"echo_lost": True}, Cause.ECHO_LOST),
        ({"foreign_setpoints": True}, Cause.FOREIGN_SETPOINTS),
    ],
)
def test_each_reason_alone_refuses(change, cause):
    story = Story()
    story.tick(VehicleMode.HOLD)
    out = story.tick(VehicleMode.HOLD, confirm=True, **change)
    assert out.reasons == (cause,)
    assert out.action is Action.NONE
    assert not out.engaging


@pytest.mark.parametrize("latency", [None, 0.41, math.nan, -0.1])
def test_an_unknown_or_long_latency_refuses(latency):
    out = refusals(healthy(1.0, latency_s=latency), 1.0, CONFIG)
    assert set(out) == {Cause.LATENCY, Cause.NO_TARGET}


def test_an_unknown_battery_does_not_refuse():
    assert refusals(healthy(1.0, battery_frac=None), 1.0, CONFIG) == ()


@pytest.mark.parametrize("mode", [mode for mode in VehicleMode if mode not in (VehicleMode.HOLD, VehicleMode.EXTERNAL)])
def test_only_hold_or_external_may_be_confirmed(mode):
    assert refusals(healthy(1.0, mode), 1.0, CONFIG) == (Cause.MODE,)


def test_a_vehicle_that_does_not_take_up_the_mode_is_released():
    story = Story()
    story.tick(VehicleMode.HOLD)
    story.tick(VehicleMode.HOLD, confirm=True)
    outs = story.ticks(32, mode=VehicleMode.HOLD)
    assert outs[28].action is Action.ENGAGE
    last = outs[-1]
    assert (last.state, last.action, last.reasons) == (
        State.RELEASED, Action.COMMAND_HOLD, (Cause.MODE_REFUSED,),
    )  # fmt: skip


def test_the_pilot_wins_while_engaging_too():
    story = Story()
    story.tick(VehicleMode.HOLD)
    story.tick(VehicleMode.HOLD, confirm=True)
    out = story.tick(VehicleMode.MANUAL)
    assert (out.state, out.action) == (State.TAKEN_OVER, Action.SILENCE)


def test_an_unseen_target_fades_holds_and_releases_on_time():
    story = Story().follow()
    seen = story.now
    outs = [(story.now - seen, story.tick(measured_t_s=seen)) for _ in range(64)]
    outs = [(round(t + TICK, 3), out) for t, out in outs]
    for age, out in outs:
        if age <= 0.3:
            assert (out.state, out.velocity_factor) == (State.FOLLOWING, 1.0)
        elif age < 0.999:
            assert out.state is State.COASTING
            assert out.action is Action.SEND_REQUEST
            assert out.velocity_factor == pytest.approx((1.0 - age) / 0.7, abs=1e-6)
            assert out.reasons == (Cause.TARGET_UNSEEN,)
        elif 1.001 < age < 2.999:
            assert (out.state, out.action, out.velocity_factor) == (State.LOST_HOLD, Action.SEND_ZERO, 0.0)
        elif age > 3.051:
            assert out.state is State.RELEASED
            assert out.reasons[0] is Cause.TARGET_LOST
    assert {out.state for _, out in outs} == {State.FOLLOWING, State.COASTING, State.LOST_HOLD, State.RELEASED}


@pytest.mark.parametrize("ticks", [8, 22, 58])
def test_a_target_back_in_time_is_followed_again(ticks):
    story = Story().follow()
    story.ticks(ticks, measured_t_s=story.now)
    assert story.out.state in (State.COASTING, State.LOST_HOLD)
    assert story.tick().state is State.FOLLOWING


def test_its_times_are_those_of_the_configuration():
    story = Story()
    story.machine = Engagement(EngagementConfig(lost_s=0.6, release_s=1.2))
    story.follow()
    states = [out.state for out in story.ticks(30, measured_t_s=story.now)]
    assert states.count(State.COASTING) == 6
    assert states.count(State.LOST_HOLD) == 12


def test_a_request_from_before_the_follow_is_not_a_stall():
    story = Story()
    story.tick(VehicleMode.HOLD)
    story.tick(VehicleMode.HOLD, confirm=True)
    for out in story.ticks(10, request_t_s=story.now - 60.0):
        assert out.state is State.FOLLOWING


def test_a_target_back_too_late_needs_the_operator():
    story = Story().follow()
    story.ticks(65, measured_t_s=story.now)
    assert story.out.state is State.RELEASED
    for out in story.ticks(100, mode=VehicleMode.HOLD):
        assert out.state is State.RELEASED
        assert out.velocity_factor == 0.0


@pytest.mark.parametrize("change", [{"rejections_in_a_row": 5}, {"latency_s": 0.45}])
def test_disagreement_and_old_pictures_count_as_unseen(change):
    story = Story().follow()
    assert story.tick(**change).state is State.COASTING
    assert story.out.velocity_factor == 1.0  # not yet: the target was seen a tick ago
    states = {out.state for out in story.ticks(70, **change)}
    assert states == {State.COASTING, State.LOST_HOLD, State.RELEASED}


def test_stalled_requests_release_after_a_second():
    story = Story().follow()
    asked = story.now
    outs = story.ticks(19, request_t_s=asked)
    assert all(out.state is State.FOLLOWING for out in outs)
    assert story.ticks(3, request_t_s=asked)[-1].reasons == (Cause.STALLED,)
    story = Story().follow()
    assert story.ticks(22, request_t_s=None)[-1].reasons == (Cause.STALLED,)


def test_hold_is_asked_for_until_it_is_seen_and_a_moment_longer():
    story = Story().follow()
    story.tick(abort=True)
    assert all(out.action is Action.COMMAND_HOLD for out in story.ticks(5))
    outs = story.ticks(12, mode=VehicleMode.HOLD)
    assert outs[0].action is Action.COMMAND_HOLD
    assert outs[-1].action is Action.SILENCE
    assert Cause.HOLD_REFUSED not in outs[-1].reasons


def test_a_hold_that_is_refused_ends_in_silence_and_says_so():
    story = Story().follow()
    story.tick(abort=True)
    outs = story.ticks(60)
    assert outs[30].action is Action.COMMAND_HOLD
    assert outs[-1].action is Action.SILENCE
    assert outs[-1].reasons == (Cause.ABORT, Cause.HOLD_REFUSED)


def test_hold_is_not_asked_for_against_the_pilot():
    story = Story().follow()
    story.tick(abort=True)
    assert story.tick(VehicleMode.MANUAL).action is Action.SILENCE
    assert story.tick(VehicleMode.MANUAL).action is Action.SILENCE


def test_released_ends_by_a_new_selection_or_acknowledgement_and_then_needs_confirming():
    for act in ({"select": True}, {"acknowledge": True}):
        story = Story().reach(State.RELEASED)
        refused = story.tick(VehicleMode.HOLD, confirm=True)
        assert (refused.state, refused.reasons) == (State.RELEASED, (Cause.ACKNOWLEDGE,))
        cleared = story.tick(VehicleMode.HOLD, **act)
        assert (cleared.state, cleared.action, cleared.reasons) == (State.SELECTED, Action.NONE, ())
        assert story.tick(VehicleMode.HOLD).action is Action.NONE
        assert story.tick(VehicleMode.HOLD, confirm=True).action is Action.ENGAGE


def test_taken_over_is_latched_until_acknowledged():
    story = Story().reach(State.TAKEN_OVER)
    for mode in (VehicleMode.MANUAL, VehicleMode.EXTERNAL, VehicleMode.HOLD):
        for act in ({}, {"select": True}, {"confirm": True}):
            out = story.tick(mode, **act)
            assert (out.state, out.action) == (State.TAKEN_OVER, Action.SILENCE)
    assert story.tick(VehicleMode.HOLD, acknowledge=True).state is State.SELECTED


def test_abort_commands_hold_wherever_the_vehicle_obeys_setpoints():
    for state in (State.SELECTED, State.IDLE, State.TAKEN_OVER, State.RELEASED):
        out = Story().reach(state).tick(abort=True)
        assert (out.state, out.action) == (State.RELEASED, Action.COMMAND_HOLD)
        quiet = Story().reach(state).tick(VehicleMode.MANUAL, abort=True)
        assert quiet.action in (Action.NONE, Action.SILENCE)
    story = Story()
    story.tick(VehicleMode.HOLD)
    story.tick(VehicleMode.HOLD, confirm=True)
    assert story.tick(VehicleMode.HOLD, abort=True).action is Action.COMMAND_HOLD


def test_abort_beats_confirm():
    story = Story().reach(State.SELECTED)
    out = story.tick(VehicleMode.HOLD, abort=True, confirm=True)
    assert (out.action, out.engaging) == (Action.NONE, False)

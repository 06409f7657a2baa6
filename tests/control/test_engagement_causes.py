"""What each cause does to a follow, what it takes to go on, and what a flickering cause ends in."""

import pytest

from control.engagement import Action, Cause, State
from control.types import VehicleMode

from .engagement_story import TICK, Story


@pytest.mark.parametrize("state", [State.FOLLOWING, State.COASTING, State.LOST_HOLD])
@pytest.mark.parametrize(
    ("change", "end", "cause"),
    [
        ({"abort": True}, State.RELEASED, Cause.ABORT),
        ({"heartbeat_t_s": 0.0}, State.RELEASED, Cause.LINK_LOST),
        ({"mode_t_s": 0.0}, State.RELEASED, Cause.LINK_LOST),
        ({"attitude_t_s": 0.0}, State.RELEASED, Cause.TELEMETRY_STALE),
        ({"position_t_s": None}, State.RELEASED, Cause.TELEMETRY_STALE),
        ({"outside_fence": True}, State.RELEASED, Cause.OUTSIDE_FENCE),
        ({"camera_wrong": True}, State.RELEASED, Cause.CAMERA_WRONG),
        ({"echo_lost": True}, State.RELEASED, Cause.ECHO_LOST),
        ({"foreign_setpoints": True}, State.RELEASED, Cause.FOREIGN_SETPOINTS),
        ({"dt": 0.21}, State.RELEASED, Cause.OWN_GAP),
        ({"dt": -0.01}, State.RELEASED, Cause.OWN_GAP),
        ({"mode": VehicleMode.MANUAL}, State.TAKEN_OVER, Cause.MODE_CHANGED),
        ({"mode": VehicleMode.HOLD}, State.TAKEN_OVER, Cause.MODE_CHANGED),
        ({"mode": VehicleMode.RETURN}, State.TAKEN_OVER, Cause.MODE_CHANGED),
        ({"armed": False}, State.TAKEN_OVER, Cause.NOT_ARMED),
        ({"failsafe": True}, State.TAKEN_OVER, Cause.FAILSAFE),
    ],
)
def test_what_ends_a_follow(state, change, end, cause):
    story = Story()
    if state is State.FOLLOWING:
        story.follow()
    else:
        story.reach(state)
    out = story.tick(**change)
    assert (out.state, out.reasons) == (end, (cause,))
    holds = end is State.RELEASED and cause is not Cause.OWN_GAP  # after which we listen first
    assert out.action is (Action.COMMAND_HOLD if holds else Action.SILENCE)
    assert out.velocity_factor == 0.0


def test_after_a_gap_of_our_own_hold_is_commanded_once_the_mode_is_heard_anew():
    story = Story().follow()
    story.tick(dt=2.0)
    gap_end_s = story.now
    while story.now + TICK < gap_end_s + 0.1:  # what had waited in the socket looks new and is old
        assert story.tick().action is Action.SILENCE
    assert {story.tick(mode_t_s=gap_end_s + 0.09).action for _ in range(6)} == {Action.SILENCE}
    assert story.out.settling  # a selection made now would be lost: orders wait
    assert story.tick(mode_t_s=gap_end_s + 0.11).action is Action.COMMAND_HOLD
    assert story.tick().action is Action.COMMAND_HOLD
    assert story.out.settling
    assert story.ticks(12, mode=VehicleMode.HOLD)[-1].action is Action.SILENCE
    assert not story.out.settling
    assert story.tick(VehicleMode.HOLD, select=True).state is State.SELECTED


def test_after_a_gap_of_our_own_a_vehicle_that_helped_itself_is_left_alone():
    story = Story().follow()
    story.tick(dt=2.0)
    actions = [story.tick(mode_t_s=story.now - 2.0).action]
    actions += [out.action for out in story.ticks(40, mode=VehicleMode.RETURN, failsafe=True)]
    assert set(actions) == {Action.SILENCE}


def test_after_a_gap_of_our_own_and_no_word_of_the_mode_nothing_is_commanded_and_it_can_be_acknowledged():
    story = Story().follow()
    story.tick(dt=2.0)
    heard_s = story.now
    assert {out.action for out in story.ticks(30, mode_t_s=heard_s)} == {Action.SILENCE}
    assert story.tick(acknowledge=True).state is State.SELECTED


def test_an_abort_after_a_gap_of_our_own_holds_at_once():
    story = Story().follow()
    story.tick(dt=2.0)
    assert story.tick(abort=True).action is Action.COMMAND_HOLD


def test_all_causes_of_the_worst_severity_are_named_in_the_order_of_the_table():
    out = Story().follow().tick(heartbeat_t_s=0.0, outside_fence=True, measured_t_s=0.0, dt=0.3)
    assert out.reasons == (Cause.LINK_LOST, Cause.OUTSIDE_FENCE, Cause.OWN_GAP)
    out = Story().follow().tick(VehicleMode.MANUAL, failsafe=True, outside_fence=True)
    assert out.reasons == (Cause.FAILSAFE, Cause.MODE_CHANGED)


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ({"battery_frac": 0.29}, Cause.BATTERY),
        ({"lossy": True}, Cause.LOSSY),
        ({"foreign_station": True}, Cause.FOREIGN_STATION),
    ],
)
def test_a_warning_is_told_in_every_state_and_changes_nothing(change, cause):
    for state in State:
        story = Story()
        story.follow() if state is State.FOLLOWING else story.reach(state)
        alike = story.copy()
        story.tick(**change)
        assert story.out.warnings == (cause,)
        alike.tick()
        assert (story.out.state, story.out.action, story.out.reasons) == (
            alike.out.state, alike.out.action, alike.out.reasons,
        )  # fmt: skip
        assert alike.out.warnings == ()


def test_a_late_tick_of_our_own_keeps_a_follow_from_beginning_for_two_seconds():
    story = Story()
    story.tick(VehicleMode.HOLD)
    late = story.now
    assert story.tick(VehicleMode.HOLD, confirm=True, late_t_s=late).reasons == (Cause.OWN_LAG,)
    while story.now < late + 1.94:
        assert not story.tick(VehicleMode.HOLD, confirm=True, late_t_s=late).engaging
    story.ticks(2, mode=VehicleMode.HOLD, late_t_s=late)
    assert story.tick(VehicleMode.HOLD, confirm=True, late_t_s=late).engaging


@pytest.mark.parametrize("change", [{"camera_wrong": True}, {"echo_lost": True}, {"foreign_setpoints": True}])
def test_an_alarm_must_be_acknowledged_and_a_new_selection_is_not_enough(change):
    story = Story().follow()
    story.tick(**change)
    story.ticks(12, mode=VehicleMode.HOLD)
    assert story.tick(VehicleMode.HOLD, select=True).state is State.RELEASED
    assert story.tick(VehicleMode.HOLD, confirm=True).reasons == (Cause.ACKNOWLEDGE,)
    assert story.tick(VehicleMode.HOLD, acknowledge=True).state is State.SELECTED
    story.tick(VehicleMode.HOLD, confirm=True)
    story.tick()
    story.tick(outside_fence=True)  # of the next follow only its own end counts
    story.ticks(12, mode=VehicleMode.HOLD)
    assert story.tick(VehicleMode.HOLD, select=True).state is State.SELECTED


def test_a_refused_hold_must_be_acknowledged():
    story = Story().follow()
    story.tick(abort=True)
    story.ticks(45)
    assert story.out.reasons == (Cause.ABORT, Cause.HOLD_REFUSED)
    assert story.tick(select=True).state is State.RELEASED
    assert story.tick(acknowledge=True).state is State.SELECTED


def flicker(story, seen_ticks, unseen_ticks, seconds):
    """The target comes and goes; the states on the way. Unseen counts from 0.3 s after it was last measured."""
    states = []
    for _ in range(round(seconds / (seen_ticks + unseen_ticks) / TICK)):
        states += [out.state for out in story.ticks(seen_ticks)]
        states += [out.state for out in story.ticks(unseen_ticks, measured_t_s=story.now)]
    return states


def test_a_target_that_keeps_flickering_does_not_keep_the_follow_alive_for_ever():
    """As PX4's start delay, the time unseen is made up for at a quarter of the speed only."""
    story = Story().follow()
    states = flicker(story, seen_ticks=1, unseen_ticks=17, seconds=9.0)  # 0.6 s of 0.9 s are coasted
    assert State.LOST_HOLD not in states  # each time it is back before a second is over
    coasted = states[: states.index(State.RELEASED)].count(State.COASTING) * TICK
    assert 3.0 < coasted < 5.0
    story = Story().follow()
    states = flicker(story, seen_ticks=1, unseen_ticks=58, seconds=9.0)  # 2.9 s: released within the second time
    assert states.index(State.RELEASED) * TICK < 5.0


def test_a_target_that_is_mostly_seen_is_followed_on():
    story = Story().follow()
    states = flicker(story, seen_ticks=40, unseen_ticks=13, seconds=60.0)  # behind a tree every 2.65 s
    assert State.COASTING in states
    assert set(states) == {State.FOLLOWING, State.COASTING}


def test_a_new_confirmation_begins_with_a_clean_slate():
    story = Story().follow()
    story.ticks(58, measured_t_s=story.now)  # 2.6 s of 3 are used up
    story.tick(abort=True)
    story.ticks(12, mode=VehicleMode.HOLD)
    story.tick(VehicleMode.HOLD, acknowledge=True)
    story.tick(VehicleMode.HOLD, confirm=True)
    story.tick()
    states = [out.state for out in story.ticks(50, measured_t_s=story.now)]
    assert State.RELEASED not in states

"""What holds in every state for every combination of what may happen in a tick, and in long random lives."""

import itertools
import random

import pytest

from control.causes import Cause, Clear, Severity
from control.engagement import Action, State
from control.types import VehicleMode

from .engagement_story import Story

MODES = (VehicleMode.EXTERNAL, VehicleMode.HOLD, VehicleMode.MANUAL)
FLAGS = {
    "disarmed": {"armed": False},
    "failsafe": {"failsafe": True},
    "link": {"heartbeat_t_s": 0.0},
    "unseen": {"measured_t_s": 0.0},
    "fence": {"outside_fence": True},
    "camera": {"camera_wrong": True},
    "abort": {"abort": True},
    "confirm": {"confirm": True},
    "select": {"select": True},
    "acknowledge": {"acknowledge": True},
    "gap": {"dt": 0.3},
}
RARE = {
    "telemetry": {"position_t_s": 0.0}, "video": {"frame_t_s": 0.0}, "unselected": {"selected": False},
    "latency": {"latency_s": 0.5}, "echo": {"echo_lost": True}, "foreign": {"foreign_setpoints": True},
    "battery": {"battery_frac": 0.1}, "late": {"late_t_s": 100.0}, "audit": {"audit_ok": False},
    "lossy": {"lossy": True}, "station": {"foreign_station": True}, "low": {"height_m": 1.0},
}  # fmt: skip
ENDS = {"link", "fence", "camera", "telemetry", "echo", "foreign", "gap"}  # RELEASE, while following
TAKES = {"disarmed", "failsafe"}
MOVING = (State.FOLLOWING, State.COASTING)
ENGAGED = (*MOVING, State.LOST_HOLD)
WAITING = (State.NO_VIDEO, State.IDLE, State.SELECTED)


def prepared(start):
    """A story that has just come to this state; "engaging" is one too."""
    story = Story()
    if start != "engaging":
        return story.follow() if start is State.FOLLOWING else story.reach(start)
    story.tick(VehicleMode.HOLD)
    assert story.tick(VehicleMode.HOLD, confirm=True).engaging
    return story


@pytest.mark.parametrize("start", [*State, "engaging"])
def test_every_state_with_every_set_of_flags(start):
    """9 states, the engaging one among them, x 3 modes x 2^11 sets of flags: no forbidden output or step."""
    before = prepared(start)
    seen = set()
    for names in itertools.chain.from_iterable(itertools.combinations(FLAGS, k) for k in range(len(FLAGS) + 1)):
        changes = {key: value for name in names for key, value in FLAGS[name].items()}
        for mode in MODES:
            out = before.copy().tick(mode, **changes)
            check_step(start, mode, set(names), out)
            seen.add(out.state)
    assert len(seen) >= 2


@pytest.mark.parametrize("start", [*State, "engaging"])
def test_every_state_with_every_four_of_all_flags(start):
    every = FLAGS | RARE
    before = prepared(start)
    for names in itertools.chain.from_iterable(itertools.combinations(every, k) for k in range(1, 4)):
        changes = {key: value for name in names for key, value in every[name].items()}
        check_step(start, VehicleMode.EXTERNAL, set(names), before.copy().tick(**changes))


def check_step(start, mode, names, out):
    """What may come of one tick, written down without the table."""
    was_engaged = start in ENGAGED or start == "engaging"
    is_ours = mode is VehicleMode.EXTERNAL or (start == "engaging" and mode is VehicleMode.HOLD)
    check_output(mode, out)
    if "abort" in names and mode is VehicleMode.EXTERNAL:
        assert (out.state, out.action) == (State.RELEASED, Action.COMMAND_HOLD)
        assert out.reasons == (Cause.ABORT,)
        return
    if "abort" in names and was_engaged and mode is VehicleMode.HOLD:
        assert (out.state, out.action) == (State.RELEASED, Action.COMMAND_HOLD)
        return
    if was_engaged:
        check_engaged(names, is_ours, out)
    elif out.state in ENGAGED or out.engaging:
        assert start in WAITING
        assert "confirm" in names
        assert names <= {"confirm", "select", "acknowledge", "gap", "lossy", "station"}, (
            "a confirmation was accepted against a refusal"
        )
    if start is State.TAKEN_OVER and out.state is not State.TAKEN_OVER:
        assert "acknowledge" in names
    if start is State.RELEASED and out.state is not State.RELEASED:
        assert {"acknowledge", "select"} & names


def check_output(mode, out):
    """State, action and factor fit together."""
    assert isinstance(out.reasons, tuple)
    assert isinstance(out.engaging, bool)
    assert out.action is not Action.SEND_REQUEST or (out.state in MOVING and mode is VehicleMode.EXTERNAL)
    assert (out.velocity_factor > 0.0) <= (out.action is Action.SEND_REQUEST)
    assert 0.0 <= out.velocity_factor <= 1.0
    assert out.action is not Action.COMMAND_HOLD or out.state is State.RELEASED
    assert out.state is not State.TAKEN_OVER or out.action is Action.SILENCE
    assert mode is not VehicleMode.MANUAL or out.action in (Action.NONE, Action.SILENCE)
    assert out.engaging == (out.action is Action.ENGAGE)
    assert not out.engaging or mode is VehicleMode.HOLD
    assert out.state is not State.FOLLOWING or out.velocity_factor == 1.0
    assert out.state not in (State.COASTING, State.LOST_HOLD, State.RELEASED, State.TAKEN_OVER) or out.reasons


def check_engaged(names, is_ours, out):
    """The worst wins: taken over, then ended, then unseen."""
    if not is_ours or names & TAKES:
        assert (out.state, out.action) == (State.TAKEN_OVER, Action.SILENCE)
    elif names & ENDS:
        listens = "gap" in names  # what has just been read may be old
        assert (out.state, out.action) == (State.RELEASED, Action.SILENCE if listens else Action.COMMAND_HOLD)
    elif not out.engaging:
        assert out.state in ENGAGED
        unseen = names & {"unseen", "latency"}
        assert (out.state is State.FOLLOWING) == (not unseen)


def test_severities_are_ordered_and_every_row_clears_as_its_severity_demands():
    assert [severity.name for severity in sorted(Severity)] == [
        "NONE", "WARN", "COAST", "ZERO", "RELEASE", "SILENT", "TAKEN_OVER", "ABORT",
    ]  # fmt: skip
    for cause in Cause:
        by_itself = cause.severity < Severity.RELEASE and cause is not Cause.ACKNOWLEDGE
        assert (cause.clear is Clear.WHEN_GONE) == by_itself, cause
        assert (cause.severity is not Severity.TAKEN_OVER) or cause.clear is Clear.BY_ACKNOWLEDGE, cause
        assert cause.refuses or cause.severity > Severity.NONE, f"{cause} does nothing"
        assert cause.value
    assert len({cause.value for cause in Cause}) == len(Cause)


@pytest.mark.parametrize("seed", range(3))
def test_random_lives_never_move_without_a_confirmation(seed):
    rng = random.Random(seed)
    story, confirmed, moved, before = Story(), False, 0, None
    every = FLAGS | RARE
    for _ in range(5000):
        changes = {}
        for flag in every.values():
            if rng.random() < 0.015:
                changes.update(flag)
        if "late_t_s" in changes:
            changes["late_t_s"] = story.now
        changes["confirm"] = rng.random() < 0.1
        changes["acknowledge"] = rng.random() < 0.1
        out = story.tick(**changes)
        confirmed = confirmed or changes["confirm"]
        if out.state not in ENGAGED:
            confirmed = out.engaging
        if out.action is Action.SEND_REQUEST:
            assert confirmed, f"seed {seed} at {story.now}"
            moved += 1
        if out.state is State.FOLLOWING and before in (State.RELEASED, State.TAKEN_OVER):
            raise AssertionError(f"seed {seed} at {story.now}: from {before} to following in one tick")
        before = out.state
    assert moved > 100

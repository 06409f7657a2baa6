"""The MAVLink camera's parameters and what it tells of the track; a follow whose clients have gone."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from control.engagement import State
from control.modes import FollowMode
from gcs.framing import Encoder, dialect
from gcs.operator.camera import messages
from gcs.operator.camera.component import Out, Say
from gcs.operator.camera.definition import definition
from gcs.operator.camera.messages import Result
from gcs.operator.camera.orders import Ask
from gcs.operator.camera.parameter_types import parameters
from gcs.operator.camera.setup import CameraSetup
from gcs.operator.orders import Abort, SelectPoint, SetMode
from tests.gcs.camera_rig import OTHER, PEER, SETUP, Rig, ask_in, kinds, results


@pytest.fixture
def rig():
    return Rig()


# -- parameters -------------------------------------------------------------------------------------------


def told(said):
    return [each.message.param_result for each in said if isinstance(each, Out) and "ACK" in each.message.get_type()]


def test_a_follow_that_is_sent_again_because_its_answer_was_lost_is_not_begun_again(rig):
    rig.settles(ask_in(rig.sets("FOLLOW", b"\1")))
    rig.station.base = replace(rig.station.base, state=State.RELEASED)  # the operator aborted on the page
    for _ in range(3):  # as QGroundControl repeats it
        rig.now_s += 3.0
        assert told(rig.sets("FOLLOW", b"\1")) == [0]
    rig.now_s += 3.1
    ask_in(rig.sets("FOLLOW", b"\1"))


def test_an_abort_is_never_taken_for_one_sent_twice(rig):
    for _ in range(3):
        assert ask_in(rig.sets("FOLLOW", b"\0")).order == Abort()


def test_a_refused_follow_is_never_told_as_failed_which_would_be_tried_again(rig):
    said = rig.settles(ask_in(rig.sets("FOLLOW", b"\1")), "not following: no GPS", Result.FAILED)
    assert told(said) == [1]
    assert kinds(said) == ["PARAM_EXT_ACK", "STATUSTEXT"]


def test_a_parameter_that_takes_long_says_so_once_a_second_until_it_is_set(rig):
    ask = ask_in(rig.sets("FOLLOW", b"\1"))
    said = [each for _, each in rig.passes(2.5)]
    assert told(said) == [3, 3, 3]
    assert told(rig.settles(ask)) == [0]
    assert told([each for _, each in rig.passes(2.0)]) == []


def test_without_leave_there_is_no_follow():
    rig = Rig(CameraSetup(7, may_follow=False))
    said = rig.sets("FOLLOW", b"\1")
    assert told(said) == [1]
    assert not [each for each in said if isinstance(each, Ask)]
    assert b'FOLLOW"' not in definition(parameters(rig.component.setup)).xml


def test_every_mode_can_be_set_by_its_number(rig):
    for number, mode in enumerate(FollowMode):
        rig.now_s += 2.0
        assert ask_in(rig.sets("FOLLOW_MODE", bytes([number]))).order == SetMode(mode)


def test_changes_are_told_to_who_has_asked_for_the_parameters(rig):
    rig.hears(messages.heartbeat(), OTHER)
    rig.hears(dialect.MAVLink_param_ext_request_list_message(7, 100))
    rig.passes(1.0)
    rig.station.base = replace(rig.station.base, follow_mode=FollowMode.ORBIT)
    changes = [each for _, each in rig.passes(1.1) if each.message.get_type() == "PARAM_EXT_VALUE"]
    assert [(each.peer, each.message.param_id) for each in changes] == [(PEER, "FOLLOW_MODE")]


def test_another_content_of_the_definition_is_another_version():
    versions = {definition(parameters(CameraSetup(7, may_follow=may))).version for may in (False, True)}
    versions.add(definition(parameters(CameraSetup(7, standoff_m=(3.0, 50.0)))).version)
    assert len(versions) == 3
    assert all(0 < version < 2**16 for version in versions)


# -- what is seen -----------------------------------------------------------------------------------------


def status_of(rig):
    *_, ack, status = rig.command(512, 275)
    assert ack.message.result == 0
    return status.message


async def tracking(rig):
    await rig.station.perform(SelectPoint(100.0, 100.0))
    rig.station.show()
    assert status_of(rig).tracking_status == 1
    return rig


async def test_hidden_for_three_seconds_is_lost_and_seen_again_is_tracked(rig):
    await tracking(rig)
    rig.station.visible = False
    seen = []
    for _ in range(40):
        rig.now_s += 0.1
        rig.station.show()
        seen.append(status_of(rig).tracking_status)
    assert set(seen[:29]) == {9}
    assert set(seen[31:]) == {0}
    rig.station.visible = True
    rig.station.show()
    assert status_of(rig).tracking_status == 1


async def test_a_video_that_stopped_is_an_error(rig):
    await tracking(rig)
    rig.now_s += 0.9
    assert status_of(rig).tracking_status == 1
    rig.now_s += 0.2
    status = status_of(rig)
    assert (status.tracking_status, status.tracking_mode) == (2, 0)
    assert math.isnan(status.rec_top_x)


async def test_a_tracker_that_failed_shows_as_an_error_for_a_while(rig):
    await tracking(rig)
    sighting = rig.station.show()
    rig.component.view.saw(replace(sighting, seen=replace(sighting.seen, result=None, problem="the tracker failed")))
    rig.station.base = replace(rig.station.base, selection=0)
    rig.station.show()
    assert status_of(rig).tracking_status == 2
    rig.now_s += 2.1
    rig.station.show()
    assert status_of(rig).tracking_status == 0


async def test_a_box_that_leaves_the_picture_is_cut_at_its_edge(rig):
    await tracking(rig)
    sighting = rig.station.show()
    box = replace(sighting.seen.result.box, cx_px=318.0, w_px=40.0)
    rig.component.view.saw(
        replace(sighting, seen=replace(sighting.seen, result=replace(sighting.seen.result, box=box)))
    )
    assert status_of(rig).rec_bottom_x == 1.0


# -- nobody left ------------------------------------------------------------------------------------------


def test_a_follow_whose_clients_have_gone_is_aborted():
    rig = Rig(replace(SETUP, abandoned_s=8.0))
    rig.settles(ask_in(rig.sets("FOLLOW", b"\1")))
    rig.station.base = replace(rig.station.base, state=State.FOLLOWING)
    rig.passes(3.0)
    rig.hears(messages.heartbeat())
    said = [(t - rig.now_s, each) for t, each in rig.passes(9.5) if isinstance(each, Say | Ask)]
    texts = [each.text for _, each in said if isinstance(each, Say)]
    assert texts == [
        "MAVLink camera: no client is heard: the follow ends in 4 s",
        "MAVLink camera: no client is heard any more: stopped and holding",
    ]
    assert next(each.order for _, each in said if isinstance(each, Ask)) == Abort()


@pytest.mark.parametrize("why", ["heard", "not followed", "from elsewhere", "elsewhere now", "never"])
def test_any_other_follow_goes_on(why):
    rig = Rig(replace(SETUP, abandoned_s=None if why == "never" else 8.0))
    rig.hears(messages.heartbeat())
    if why != "from elsewhere":
        rig.settles(ask_in(rig.sets("FOLLOW", b"\1")))
    if why != "not followed":
        rig.station.base = replace(rig.station.base, state=State.FOLLOWING)
    for _ in range(20):
        if why == "heard":
            rig.hears(messages.heartbeat(), OTHER, (254, 1))
        if why == "elsewhere now":
            rig.lease.take("terminal", rig.now_s, by_force=True)
        assert not [each for _, each in rig.passes(1.0, 0.1) if not isinstance(each, Out)]


def test_an_interval_that_no_message_can_tell_is_none(rig):
    assert results(rig.command(511, 275, 3.4e38)) == [2]
    assert results(rig.command(511, 275, 2**31)) == [2]
    assert results(rig.command(511, 275, 2e9)) == [0]
    said = rig.command(510, 275)
    assert [Encoder(7, 100).encode(each.message) for each in said]

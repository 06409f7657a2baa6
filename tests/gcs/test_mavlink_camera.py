"""The MAVLink camera without sockets, on a fake clock: when it says what, and what it makes of orders."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest

from control.engagement import State
from gcs.operator.camera import messages
from gcs.operator.camera.clients import MOST_CLIENTS, MOST_OF_HOST
from gcs.operator.camera.setup import CameraSetup
from gcs.operator.lease import LEASE_S
from gcs.operator.orders import Deselect, Select, SelectPoint
from tests.gcs.camera_rig import BOX, OTHER, PEER, Rig, ask_in, kinds, results, statuses


@pytest.fixture
def rig():
    return Rig()


# -- times ------------------------------------------------------------------------------------------------


def test_heartbeat_once_a_second_to_each_address_and_at_once_to_a_new_one(rig):
    assert kinds(rig.hears(messages.heartbeat(), PEER)) == ["HEARTBEAT"]
    assert kinds(rig.hears(messages.heartbeat(), PEER)) == []
    rig.hears(messages.heartbeat(), OTHER)
    rig.passes(0.5)
    beats = [(t, each.peer) for t, each in rig.passes(5.0)]
    for peer in (PEER, OTHER):
        times = [t for t, to in beats if to == peer]
        assert len(times) == 5
        assert all(0.98 < b - a < 1.02 for a, b in itertools.pairwise(times))


def test_who_is_silent_for_ten_seconds_is_forgotten(rig):
    rig.command(511, 275, 100_000)
    assert statuses(rig.passes(9.0))
    rig.passes(3.0)
    said = rig.passes(3.0)
    assert not statuses(said)
    assert {each.peer for _, each in said} == {None}


@pytest.mark.parametrize(("period_us", "hz"), [(500_000, 2), (0, 2), (100_000, 10), (1, 50), (20_000, 50)])
def test_the_status_comes_as_often_as_asked_but_no_more_than_fifty_times_a_second(rig, period_us, hz):
    assert results(rig.command(511, 275, period_us)) == [0]
    times = statuses(rig.passes(4.0, step_s=0.001))
    assert abs(len(times) - 4 * hz) <= 1
    assert results(rig.command(511, 275, -1)) == [0]
    assert not statuses(rig.passes(2.0))


def test_two_clients_behind_one_address_get_what_the_more_eager_one_wants(rig):
    rig.command(511, 275, 500_000)
    rig.command(511, 275, 100_000, source=(254, 1))
    assert abs(len(statuses(rig.passes(2.0))) - 20) <= 1
    rig.command(511, 275, -1, source=(254, 1))
    assert abs(len(statuses(rig.passes(2.0))) - 4) <= 1


def test_it_tells_when_it_has_to_be_asked_next(rig):
    rig.passes(0.01)
    assert rig.now_s < rig.component.due_s <= rig.now_s + 1.0
    rig.command(511, 275, 100_000)
    rig.passes(0.01)
    assert rig.component.due_s <= rig.now_s + 0.1


def test_a_flood_of_addresses_displaces_nobody_who_is_heard(rig):
    rig.hears(messages.heartbeat(), PEER)
    for number in range(3 * MOST_CLIENTS):
        rig.hears(messages.heartbeat(), ("10.0.0.1", number), (1 + number, 1))
    assert results(rig.command(521, 1)) == [0]
    assert len({each.peer for _, each in rig.passes(1.0)}) == MOST_OF_HOST + 1
    assert rig.hears(messages.heartbeat(), ("10.0.0.2", 1), (1, 1))  # nor does it keep anybody else out
    for host in range(3, 30):
        rig.hears(messages.heartbeat(), (f"10.0.0.{host}", 1), (1, 1))
    assert len({each.peer for _, each in rig.passes(1.0)}) == MOST_CLIENTS


def test_its_own_messages_come_back_and_are_nobodys(rig):
    assert rig.hears(messages.heartbeat(), PEER, (7, 100)) == []
    assert {each.peer for _, each in rig.passes(1.0)} == {None}


# -- orders -----------------------------------------------------------------------------------------------


def test_a_click_belongs_to_the_picture_that_was_seen():
    rig = Rig(CameraSetup(7, display_delay_s=0.3))
    shown = []
    for _ in range(20):
        rig.now_s += 0.05
        shown.append(rig.station.show().seen.frame)
    for number, params, kind in ((2005, BOX, Select), (2004, (0.5, 0.5, 0.0), SelectPoint)):
        order = ask_in(rig.command(number, *params)).order
        assert isinstance(order, kind)
        assert 0.299 < rig.now_s - order.frame.t_arrival_s < 0.351
        assert order.frame is not shown[-1]


def test_before_the_first_picture_there_is_nothing_to_select():
    rig = Rig(shows=False)
    said = rig.command(2005, *BOX)
    assert results(said) == [1]
    assert said[-1].message.text == "no picture has come yet"


def test_what_takes_long_is_answered_as_taken_and_what_becomes_of_it_is_told(rig):
    ask = ask_in(rig.command(2005, *BOX))
    said = [each for _, each in rig.passes(0.29)]
    assert results(said) == []
    said = [each for _, each in rig.passes(0.05)]
    assert results(said) == [0]
    said = rig.settles(ask, "no picture came within 5 s to select in")
    assert kinds(said) == ["STATUSTEXT"]
    assert rig.settles(ask, "again") == []


def test_a_box_that_another_one_has_replaced_is_not_complained_of(rig):
    first = ask_in(rig.command(2005, *BOX))
    rig.passes(0.4)
    second = ask_in(rig.command(2005, 0.1, 0.1, 0.2, 0.2))
    assert rig.settles(first, "superseded") == []
    assert results(rig.settles(second)) == [0]


def test_the_same_within_a_second_is_done_once_and_answered_each_time(rig):
    ask = ask_in(rig.command(2005, *BOX))
    assert rig.command(2005, *BOX) == []
    rig.settles(ask)
    assert results(rig.command(2005, *BOX)) == [0]
    rig.now_s += 1.1
    ask_in(rig.command(2005, *BOX))
    rig.now_s += 3.0
    assert rig.command(2005, *BOX, confirmation=1) == []
    rig.now_s += 10.0
    ask_in(rig.command(2005, *BOX, confirmation=2))


def test_a_stop_in_between_makes_it_another_wish(rig):
    rig.settles(ask_in(rig.command(2005, *BOX)))
    assert ask_in(rig.command(2010)).order == Deselect()
    ask_in(rig.command(2005, *BOX))


def test_control_is_taken_by_ordering_and_lost_by_silence(rig):
    rig.settles(ask_in(rig.command(2005, *BOX)))
    assert rig.lease.holder(rig.now_s) == "camera 255/190 at 127.0.0.1:40001"
    assert results(rig.command(2010, source=(254, 1), peer=OTHER)) == [1]
    rig.now_s += LEASE_S + 0.1
    rig.hears(messages.heartbeat())  # being there is not ordering
    assert ask_in(rig.command(2010, source=(254, 1), peer=OTHER))


def test_who_began_a_follow_keeps_control_while_it_lasts(rig):
    rig.settles(ask_in(rig.sets("FOLLOW", b"\1")))
    rig.station.base = replace(rig.station.base, state=State.FOLLOWING)
    for _ in range(10):
        rig.now_s += 1.0
        rig.hears(messages.heartbeat())
    assert rig.lease.holder(rig.now_s) == "camera 255/190 at 127.0.0.1:40001"
    rig.station.base = replace(rig.station.base, state=State.RELEASED)
    for _ in range(6):
        rig.now_s += 1.0
        rig.hears(messages.heartbeat())
    assert rig.lease.holder(rig.now_s) == ""


def test_the_end_of_a_follow_is_told_once_with_its_reason(rig):
    for state in (State.FOLLOWING, State.RELEASED):
        rig.station.base = replace(rig.station.base, state=state, reasons=("the battery is low",))
        said = [each.message.text for _, each in rig.passes(3.0) if each.message.get_type() == "STATUSTEXT"]
        assert said == (["RELEASED: the battery is low"] if state is State.RELEASED else [])

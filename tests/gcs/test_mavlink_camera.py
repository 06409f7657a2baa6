"""The MAVLink camera without sockets, on a fake clock: when it says what, and what it makes of orders."""

from __future__ import annotations

import itertools
import math
import random
import struct
from dataclasses import replace

import pytest

from control.engagement import State
from control.modes import FollowMode
from gcs.errors import WireError
from gcs.framing import Deframer, Encoder, dialect
from gcs.operator.camera import messages
from gcs.operator.camera.clients import MOST_CLIENTS, MOST_OF_HOST
from gcs.operator.camera.component import CameraComponent, Out, Say
from gcs.operator.camera.definition import definition
from gcs.operator.camera.intake import ALL_STRANGE, KNOWN, STRANGE, Intake
from gcs.operator.camera.messages import Result
from gcs.operator.camera.orders import Ask, Problem
from gcs.operator.camera.parameter_types import parameters
from gcs.operator.camera.setup import CameraSetup, free_component_id
from gcs.operator.lease import LEASE_S, Lease
from gcs.operator.orders import Abort, Confirm, Deselect, Select, SelectPoint, SetMode
from tests.gcs.fake_station import FakeStation

PEER, OTHER = ("127.0.0.1", 40_001), ("127.0.0.1", 40_002)
GCS = (255, 190)
SETUP = CameraSetup(7, may_follow=True)
BOX = (0.25, 0.25, 0.5, 0.75)


class Rig:
    """A component with what stands round it; times in s."""

    def __init__(self, setup: CameraSetup = SETUP, *, shows: bool = True) -> None:
        self.now_s = 100.0
        self.station = FakeStation(size=(320, 240), now_s=lambda: self.now_s)
        self.lease = Lease()
        self.component = CameraComponent(setup, self.station, self.lease, self.now_s)
        self.station.watch(self.component.view)
        self.codecs: dict[tuple[int, int], tuple[Encoder, Deframer]] = {}
        if shows:
            self.station.show()

    def hears(self, message, peer=PEER, source=GCS):
        """What it answers to this message, which goes through the wire's bytes."""
        encoder, deframer = self.codecs.setdefault(source, (Encoder(*source), Deframer()))
        (heard,) = deframer.datagram(encoder.encode(message))
        return self.component.received(heard, peer, self.now_s)

    def command(self, number, *params, confirmation=0, peer=PEER, source=GCS):
        seven = (*params, *[0.0] * (7 - len(params)))
        return self.hears(dialect.MAVLink_command_long_message(7, 100, number, confirmation, *seven), peer, source)

    def sets(self, name, value, kind=1):
        return self.hears(dialect.MAVLink_param_ext_set_message(7, 100, name.encode(), value, kind))

    def passes(self, seconds, step_s=0.01):
        """What it says in this time: (s, message)."""
        said = []
        for _ in range(round(seconds / step_s)):
            self.now_s += step_s
            said += [(self.now_s, each) for each in self.component.tick(self.now_s)]
        return said

    def settles(self, ask, why="", result=Result.TEMPORARILY_REJECTED):
        return self.component.settled(ask, Problem(result, why) if why else None, self.now_s)


@pytest.fixture
def rig():
    return Rig()


def kinds(said):
    return [each.message.get_type() if isinstance(each, Out) else type(each.order).__name__ for each in said]


def results(said):
    acks = [each.message for each in said if isinstance(each, Out) and each.message.get_type() == "COMMAND_ACK"]
    return [ack.result for ack in acks]


def ask_in(said):
    (ask,) = (each for each in said if isinstance(each, Ask))
    return ask


def statuses(said):
    return [t for t, each in said if each.message.get_type() == "CAMERA_TRACKING_IMAGE_STATUS"]


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


# -- the rest ---------------------------------------------------------------------------------------------


def test_the_next_free_component_id():
    assert free_component_id(100, ()) == 100
    assert free_component_id(100, {100, 101}) == 102
    assert free_component_id(105, {105}) == 100
    with pytest.raises(WireError, match="already has cameras"):
        free_component_id(100, range(100, 106))


@pytest.mark.parametrize("length", [1, 49, 50, 51, 99, 100, 101, 249, 400])
def test_long_texts_come_in_chunks_that_say_where_they_end(length):
    text = ("abcdefghij" * 40)[:length]
    chunks = [(m.id, m.chunk_seq, m.text) for m in messages.texts(text, 5)]
    assert "".join(part for _, _, part in chunks) == text[:249]
    if length > 50:
        assert [number for _, number, _ in chunks] == list(range(len(chunks)))
        assert all(len(part) == 50 for _, _, part in chunks[:-1])
        assert len(chunks[-1][2]) < 50


def test_a_flood_from_one_address_is_not_even_decoded_and_another_is_still_heard():
    intake, data = Intake(), Encoder(*GCS).encode(messages.heartbeat())

    def read(host, now_s=1.0, times=1000, known=False):
        return sum(len(intake.messages(data, (host, port), now_s, known=known)) for port in range(times))

    assert read("10.0.0.1") == STRANGE.at_once
    assert read("10.0.0.2") == STRANGE.at_once
    assert read("10.0.0.1", 2.0) == STRANGE.at_once
    assert read("10.0.0.1", 2.1) == pytest.approx(0.1 * STRANGE.per_s)
    assert sum(read(f"10.0.1.{host}", 9.0, 20) for host in range(9)) == ALL_STRANGE.at_once
    assert sum(len(intake.messages(data, PEER, 9.0, known=True)) for _ in range(1000)) == KNOWN.at_once
    assert len(intake.messages(data, OTHER, 9.0, known=True)) == 1


@pytest.mark.parametrize("known", [True, False])
def test_no_single_datagram_costs_much(known):
    frame = Encoder(*GCS).encode(messages.heartbeat())
    for data, most in ((frame * 3000, 0), (frame * 90, 8), (b"\xfd" * 4000, 0), (frame + b"\xfd" * 400, 0), (b"", 0)):
        assert len(Intake().messages(data, PEER, 1.0, known=known)) == most
    assert len(Intake().messages(b"\xfd" + frame + b"?", PEER, 1.0, known=known)) == 1


def test_two_of_the_same_ids_at_different_addresses_are_two(rig):
    rig.settles(ask_in(rig.command(2005, *BOX)))
    assert results(rig.command(2010, peer=OTHER)) == [1]


def test_telemetry_that_a_router_sends_along_costs_nothing():
    intake, data = Intake(), Encoder(7, 1).encode(dialect.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0))
    for _ in range(10_000):
        assert intake.messages(data, PEER, 1.0, known=True) == []
    assert intake.dropped == 0


NUMBERS = [0.0, -0.0, 1.0, -1.0, 0.5, 275.0, 276.0, 262.0, 100.0, 1e-45, 3.4e38, -3.4e38, math.nan, math.inf, -math.inf]
FUZZED = [*range(505, 535), *range(1000, 1003), *range(2000, 2012), *range(2500, 2510), 400, 0, 65_535]


def test_any_message_with_any_numbers_is_answered_or_ignored_and_never_breaks_it(rig):
    seed = random.randrange(2**32)
    dice = random.Random(seed)
    encoder = Encoder(7, 100)
    for _ in range(4000):
        number, target = dice.choice(FUZZED), (dice.choice((0, 7, 8)), dice.choice((0, 100, 101)))
        params = [dice.choice((*NUMBERS, dice.uniform(-2, 2))) for _ in range(7)]
        whole = [dice.choice((0, 1, -(2**31), 2**31 - 1)) for _ in range(2)]
        made = dice.choice(
            (
                dialect.MAVLink_command_long_message(*target, number, dice.randrange(256), *params),
                dialect.MAVLink_command_int_message(*target, 0, number, 0, 0, *params[:4], *whole, params[6]),
                dialect.MAVLink_param_ext_set_message(
                    *target,
                    dice.choice((b"FOLLOW", b"FOLLOW_STANDOFF", b"HEIGHT", dice.randbytes(16))),
                    dice.choice((dice.randbytes(128), struct.pack("<f", dice.choice(NUMBERS)))),
                    dice.randrange(256),
                ),
                dialect.MAVLink_param_ext_request_read_message(*target, dice.randbytes(16), dice.randrange(-9, 9)),
            )
        )
        rig.now_s += dice.choice((0.0, 0.01, 0.3))
        said = rig.hears(made, dice.choice((PEER, OTHER))) + rig.component.tick(rig.now_s)
        for ask in [each for each in said if isinstance(each, Ask)]:
            said += rig.component.settled(ask, dice.choice((None, Problem(Result.DENIED, "no"))), rig.now_s)
            assert not isinstance(ask.order, Confirm) or made.get_type() == "PARAM_EXT_SET"
        for each in said:
            assert isinstance(each, Ask) or encoder.encode(each.message), f"seed {seed}"


def test_any_bytes_are_survived(rig):
    seed = random.randrange(2**32)
    dice, intake = random.Random(seed), Intake()
    good = Encoder(*GCS).encode(dialect.MAVLink_command_long_message(7, 100, 521, 0, 1, 0, 0, 0, 0, 0, 0))
    for step in range(3000):
        data = bytearray(dice.choice((good, dice.randbytes(dice.randrange(300)), good * 3)))
        for _ in range(dice.randrange(3)):
            if data:
                data[dice.randrange(len(data))] = dice.randrange(256)
        for message in intake.messages(bytes(data), PEER, step / 50, known=True):
            rig.component.received(message, PEER, rig.now_s)
    assert results(rig.command(521, 1)) == [0], f"seed {seed}"


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

"""The MAVLink camera and what no client should send: floods, odd numbers, any bytes."""

from __future__ import annotations

import math
import random
import struct

import pytest

from gcs.errors import WireError
from gcs.framing import Encoder, dialect
from gcs.operator.camera import messages
from gcs.operator.camera.intake import ALL_STRANGE, KNOWN, STRANGE, Intake
from gcs.operator.camera.messages import Result
from gcs.operator.camera.orders import Ask, Problem
from gcs.operator.camera.setup import free_component_id
from gcs.operator.orders import Confirm
from tests.gcs.camera_rig import BOX, GCS, OTHER, PEER, Rig, ask_in, results


@pytest.fixture
def rig():
    return Rig()


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

"""STATUSTEXT put together from its chunks."""

from __future__ import annotations

from pymavlink.dialects.v20 import development as mav

from gcs.framing import Deframer, Encoder
from gcs.statustext import StatusTextAssembler


def text(words, number=0, chunk=0, severity=4):
    return mav.MAVLink_statustext_message(severity, words.encode(), number, chunk)


def messages(*parts):
    return [Deframer().datagram(Encoder(1, 1).encode(part))[0] for part in parts]


def test_chunks_become_one_text_without_px4s_tab():
    first, last = "Arming denied: Resolve system health failures firs", "t\t"
    assembler = StatusTextAssembler()
    one, two = messages(text(first, 7, 0), text(last, 7, 1))
    assert assembler.add(one, 1.0) == []
    (whole,) = assembler.add(two, 1.1)
    assert whole.text == "Arming denied: Resolve system health failures first"
    assert (whole.t_s, whole.severity) == (1.0, 4)


def test_chunks_in_any_order_and_two_texts_at_once():
    assembler = StatusTextAssembler()
    parts = messages(text("b" * 3, 8, 1), text("x" * 50, 9, 0), text("a" * 50, 8, 0), text("y", 9, 1))
    texts = [done.text for part in parts for done in assembler.add(part, 1.0)]
    assert texts == ["a" * 50 + "bbb", "x" * 50 + "y"]


def test_a_lost_chunk_shows_as_a_gap():
    assembler = StatusTextAssembler()
    parts = messages(text("a" * 50, 8, 0), text("end", 8, 2))
    assert [assembler.add(part, 1.0) for part in parts] == [[], []]
    assert assembler.expire(1.9) == []
    (torn,) = assembler.expire(2.1)
    assert torn.text == "a" * 50 + " … end"
    only_first = messages(text("b" * 50, 9, 0))[0]
    assembler.add(only_first, 5.0)
    assert assembler.expire(7.0)[0].text == "b" * 50 + " …"


def test_texts_cannot_write_to_the_terminal_or_fill_the_memory():
    assembler = StatusTextAssembler()
    (clean,) = assembler.add(messages(text("\x1b[31mred\r\n"))[0], 1.0)
    assert clean.text == "[31mred"
    for number in range(1, 1000):
        assembler.add(messages(text("a" * 50, number, 255))[0], 1.0)
        assembler.add(messages(text("a" * 50, number, 0))[0], 1.0)
    assert len(assembler._unfinished) <= 8

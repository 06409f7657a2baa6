"""The operator's words and keys at the terminal, and what they mean."""

from __future__ import annotations

import pytest

from control.modes import FollowMode
from gcs.clock import FakeClock
from gcs.operator.orders import (
    Abort,
    Acknowledge,
    Confirm,
    Deselect,
    Hold,
    Land,
    Order,
    OrderError,
    Quit,
    Record,
    Return,
    Select,
    SelectCandidate,
    SetDistance,
    SetMode,
    SetStandoff,
    StepStandoff,
    TakeOff,
    parse_order,
)
from gcs.operator.terminal_keys import LINE_S, Key, Keys, Lines, Typed
from tracker.box import Box


@pytest.mark.parametrize(
    ("line", "order"),
    [
        ("box 10 20 30 40", Select(Box(25.0, 40.0, 30.0, 40.0))),
        ("follow", Confirm()),
        ("  FOLLOW ", Confirm()),
        ("ack", Acknowledge()),
        ("abort", Abort()),
        ("hold", Hold()),
        ("takeoff", TakeOff(None)),
        ("takeoff 12.5", TakeOff(12.5)),
        ("land", Land()),
        ("rtl", Return()),
        ("spotlight", SetMode(FollowMode.SPOTLIGHT)),
        ("mode follow", SetMode(FollowMode.FOLLOW)),
        ("mode parallel", SetMode(FollowMode.PARALLEL)),
        ("mode orbit", SetMode(FollowMode.ORBIT)),
        ("approach", StepStandoff(-2.0)),
        ("approach 3.5", StepStandoff(-3.5)),
        ("retreat 1", StepStandoff(1.0)),
        ("standoff 15", SetStandoff(15.0)),
        ("standoff now", SetStandoff(None)),
        ("distance 20", SetDistance(20.0)),
        ("distance auto", SetDistance(None)),
        ("quit", Quit()),
    ],
)
def test_every_order_has_its_words(line: str, order: Order) -> None:
    assert parse_order(line) == order


@pytest.mark.parametrize(
    "line",
    ["", "fly", "box 1 2 3", "box a b c d", "box 0 0 0 10", "box nan 0 10 10", "takeoff -3", "takeoff inf",
     "standoff 0", "mode sideways", "approach -2", "retreat far", "follow now", "land 3"],
)  # fmt: skip
def test_a_wrong_line_says_what_was_expected(line: str) -> None:
    with pytest.raises(OrderError) as error:
        parse_order(line)
    assert "expected" in str(error.value) or "box X Y W H" in str(error.value)
    assert "\n" not in str(error.value)


def typed(text: str) -> list[Typed]:
    return list(Keys(lambda: 0.0).feed(text))


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        (" ", Abort()),
        ("\x1b", Abort()),
        ("[", StepStandoff(-1.0)),
        ("]", StepStandoff(1.0)),
        ("3", SelectCandidate(3)),
        ("c", Key.CANDIDATES),
        ("\x0c", Key.REDRAW),
        ("f\r", Confirm()),
        ("F\n", Confirm()),
        ("q\r", Quit()),
        ("d\r", Deselect()),
        ("a\r", Acknowledge()),
        ("r\r", Record()),
        ("m\r", Key.MODE),
        (":f\r", Confirm()),
        (":record off\r", Record(False)),
    ],
)
def test_a_key_has_its_meaning(text: str, meant: Typed) -> None:
    assert typed(text) == [meant]


@pytest.mark.parametrize(
    "line", ["abort", "follow", "mode orbit", "drop", "accept COM_RC_IN_MODE", "quit", "record on"]
)
def test_words_that_begin_like_a_key_are_still_words(line: str) -> None:
    assert typed(line) == []
    assert typed(line + "\r") == [parse_order(line)]


def test_one_letter_confirms_nothing() -> None:
    assert typed("f") == []
    assert typed("ff") == []
    assert typed("f\x7f\r") == []


def test_an_enter_that_comes_much_later_confirms_nothing() -> None:
    clock = FakeClock()
    keys = Keys(clock.now_s)
    assert list(keys.feed("f")) == []
    clock.advance(LINE_S - 0.1)
    assert keys.line == "f"
    clock.advance(0.2)
    assert keys.line == ""
    assert list(keys.feed("\r")) == []
    assert list(keys.feed("f\r")) == [Confirm()]


def test_space_aborts_after_a_single_letter_too() -> None:
    assert typed("f \r") == [Abort()]


def test_a_typed_line_takes_spaces_and_letters_but_escape_still_aborts() -> None:
    keys = Keys(lambda: 0.0)
    assert list(keys.feed("box 1 2 30 4x")) == []
    assert list(keys.feed("\x7f0 \r")) == [Select(Box(16.0, 22.0, 30.0, 40.0))]
    assert keys.line == ""
    assert list(keys.feed("land")) == []
    assert list(keys.feed("\x1b")) == [Abort()]
    assert keys.line == ""


@pytest.mark.parametrize("text", ["\x1b[A", "\x1bOP", "\x1b[15~", "\x1b[1;5C", "\x1b[A\x1b[B"])
def test_arrow_and_function_keys_are_no_escape(text: str) -> None:
    assert typed(text) == []


@pytest.mark.parametrize("text", ["\x1b\x1b\x1b", "\x1b\x1b[A", "f\x1b", "\x1b["])
def test_escape_aborts_however_hastily_it_is_struck(text: str) -> None:
    assert Abort() in typed(text)
    assert Confirm() not in typed(text)


def test_lines_come_whole_however_they_are_cut() -> None:
    lines = Lines()
    assert list(lines.feed("hol")) == []
    assert list(lines.feed("d\n\nland\nab")) == [Hold(), Land()]
    assert list(lines.feed("ort\n")) == [Abort()]

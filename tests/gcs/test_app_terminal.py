"""The operator's words, keys and screen."""

from __future__ import annotations

import asyncio
import io
import os

import pytest

from control.modes import FollowMode
from gcs.errors import VehicleError
from gcs.operator.orders import (
    Abort,
    Acknowledge,
    Confirm,
    Hold,
    Land,
    Order,
    OrderError,
    Quit,
    Return,
    Select,
    SetDistance,
    SetMode,
    SetStandoff,
    StepStandoff,
    TakeOff,
    parse_order,
)
from gcs.operator.terminal import Keys, Lines, Screen, TerminalOperator
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


def test_single_keys_act_at_once() -> None:
    assert list(Keys().feed("f")) == [Confirm()]
    assert list(Keys().feed(" ")) == [Abort()]
    assert list(Keys().feed("\x1b")) == [Abort()]
    assert list(Keys().feed("q")) == [Quit()]


def test_a_typed_line_takes_spaces_and_letters_but_escape_still_aborts() -> None:
    keys = Keys()
    assert list(keys.feed("box 1 2 30 4x")) == []
    assert list(keys.feed("\x7f0 \r")) == [Select(Box(16.0, 22.0, 30.0, 40.0))]
    assert keys.line == ""
    assert list(keys.feed("land")) == []
    assert list(keys.feed("\x1b")) == [Abort()]
    assert keys.line == ""


def test_arrow_keys_are_no_escape() -> None:
    assert list(Keys().feed("\x1b[A")) == []


def test_lines_come_whole_however_they_are_cut() -> None:
    lines = Lines()
    assert list(lines.feed("hol")) == []
    assert list(lines.feed("d\n\nland\nab")) == [Hold(), Land()]
    assert list(lines.feed("ort\n")) == [Abort()]


class Flying:
    """Records orders; take-off takes long, land is refused."""

    def __init__(self) -> None:
        self.orders: list[Order] = []
        self.came = asyncio.Event()

    async def perform(self, order: Order) -> str:
        self.orders.append(order)
        self.came.set()
        if isinstance(order, TakeOff):
            await asyncio.sleep(60)
        if isinstance(order, Land):
            raise VehicleError("the vehicle refused")
        return "done"

    def status_line(self) -> str:
        return "status"


async def test_orders_from_a_pipe_do_not_wait_for_each_other_and_answers_are_said() -> None:
    read, write = os.pipe()
    flying, out = Flying(), io.StringIO()
    with os.fdopen(read) as stdin:
        operator = TerminalOperator(flying, Screen(out), stdin)
        task = asyncio.create_task(operator.run())
        os.write(write, b"takeoff\nabort\nland\nnonsense\n")
        os.close(write)
        while len(flying.orders) < 3:
            flying.came.clear()
            await flying.came.wait()
        await asyncio.sleep(0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
    assert flying.orders == [TakeOff(), Abort(), Land()]
    said = out.getvalue()
    assert "done" in said
    assert "the vehicle refused" in said
    assert "'nonsense' is not known" in said
    assert "status" not in said  # no live line where there is no terminal


class Terminal(io.StringIO):
    """A text stream that claims to be a terminal."""

    def isatty(self) -> bool:
        return True


def test_the_live_line_stays_last() -> None:
    out = Terminal()
    screen = Screen(out)
    screen.live("live " + "x" * 500)
    screen.say("said")
    last = out.getvalue().split("\n")[-1]
    assert last.startswith("live")
    assert len(last) < 500  # cut to the terminal's width: it must not wrap
    assert "said\n" in out.getvalue()


def test_a_closed_output_ends_nothing() -> None:
    out = io.StringIO()
    out.close()
    Screen(out).say("lost")

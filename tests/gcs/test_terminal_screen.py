"""What a terminal really shows of what the screen writes, and that a stalled one holds nobody up."""

from __future__ import annotations

import io
import os
import pty

import pytest

from gcs.operator import terminal_screen
from gcs.operator.terminal_screen import Screen
from tests.gcs.terminal_emulator import Terminal


@pytest.fixture
def out(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    monkeypatch.setenv("TERM", "xterm")
    return Terminal()


def test_the_block_stays_below_what_is_said(out: Terminal) -> None:
    screen = Screen(out)
    screen.block(["a", "b", "c"])
    screen.say("one")
    screen.block(["a", "B long", "c"])
    screen.say("two")
    screen.block(["a", "b", "c", "d"])
    assert out.rows == ["one", "two", "a", "b", "c", "d"]
    screen.block(["x"])
    screen.say("three\nlines")
    assert out.rows == ["one", "two", "three", "lines", "x"]
    screen.end()
    screen.say("after")
    assert out.rows == ["one", "two", "three", "lines", "x", "after", ""]


def test_only_what_changed_is_written(out: Terminal) -> None:
    screen = Screen(out)
    screen.block(["first", "second", "third"])
    length = len(out.getvalue())
    screen.block(["first", "second", "third"])
    assert len(out.getvalue()) == length
    screen.block(["first", "2", "third"])
    assert "first" not in out.getvalue()[length:]
    assert out.rows == ["first", "2", "third"]


def test_another_size_begins_anew_with_what_was_said_last(out: Terminal) -> None:
    screen = Screen(out)
    screen.say("said")
    screen.block(["a", "b"])
    out.write("rubbish")
    screen.repaint()
    assert out.rows == ["said", "a", "b"]
    screen.block(["a", "c"])
    assert out.rows == ["said", "a", "c"]


def test_what_is_said_cannot_steer_the_terminal(out: Terminal) -> None:
    Screen(out).say("\x1b[2Jcleared")
    assert "\x1b[2J" not in out.getvalue()
    assert out.rows == [" [2Jcleared", ""]


def test_the_live_line_is_cut_to_the_width(out: Terminal) -> None:
    screen = Screen(out)
    screen.live("live " + "x" * 5000)
    assert len(out.rows[-1]) < 5000


def test_elsewhere_there_are_only_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    out = io.StringIO()
    screen = Screen(out)
    screen.live("live")
    screen.say("said")
    assert out.getvalue() == "said\n"
    monkeypatch.setenv("TERM", "dumb")
    dumb = Terminal()
    Screen(dumb).block(["x"])
    assert dumb.getvalue() == ""


def test_a_closed_output_ends_nothing() -> None:
    out = io.StringIO()
    out.close()
    Screen(out).say("lost")


def test_all_is_written_by_the_end(out: Terminal) -> None:
    screen = Screen(out)
    screen.start()
    for number in range(100):
        screen.say(f"line {number}")
        screen.block([f"block {number}", "end"])
    screen.end()
    assert out.rows == [*(f"line {number}" for number in range(100)), "block 99", "end", ""]


def test_what_is_said_after_the_display_stands_below_it(out: Terminal) -> None:
    screen = Screen(out)
    screen.start()
    screen.block(["display", "> "])
    screen.say("leaving")
    screen.settle()
    screen.say("recorded")
    screen.end()
    assert out.rows == ["leaving", "display", "> ", "recorded", ""]


def test_a_terminal_that_takes_nothing_holds_nobody_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(terminal_screen, "_END_S", 0.05)
    person, machine = pty.openpty()
    out = os.fdopen(machine, "w")
    screen = Screen(out)
    screen.start()
    thread = screen._thread
    assert thread is not None
    for number in range(2000):  # far more than a terminal buffers
        screen.say(f"{number} " + "x" * 200)
        screen.block([str(number)])
    screen.end()
    assert thread.is_alive()  # it really was stalled
    os.close(person)
    thread.join(5.0)
    assert not thread.is_alive()
    out.close()

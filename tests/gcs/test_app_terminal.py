"""The operator at the terminal: what becomes of words and keys; on a real pseudo-terminal too."""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import io
import os
import pty
import struct
import termios
import threading
from collections.abc import AsyncIterator
from dataclasses import replace

import pytest

from control.engagement import State
from control.modes import FollowMode
from gcs.clock import FakeClock
from gcs.errors import VehicleError
from gcs.operator import terminal_screen
from gcs.operator.lease import Lease
from gcs.operator.orders import (
    Abort,
    Confirm,
    Deselect,
    Land,
    Order,
    Quit,
    SelectCandidate,
    SetMode,
    StepStandoff,
    TakeOff,
)
from gcs.operator.terminal import NAME, Screen, TerminalOperator
from tests.gcs.fake_station import FakeStation
from tests.gcs.terminal_emulator import Terminal


class Station(FakeStation):
    """Take-off takes long, land is refused; tells of every order."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.came = asyncio.Event()

    async def perform(self, order: Order) -> str:
        self.came.set()
        if isinstance(order, TakeOff):
            self.orders.append(order)
            await asyncio.sleep(60)
        if isinstance(order, Land):
            self.orders.append(order)
            raise VehicleError("the vehicle refused")
        return await super().perform(order)

    async def ordered(self, count: int) -> None:
        async with asyncio.timeout(10):
            while len(self.orders) < count:
                self.came.clear()
                await self.came.wait()
        await asyncio.sleep(0)


@contextlib.asynccontextmanager
async def operating(operator: TerminalOperator, screen: Screen) -> AsyncIterator[None]:
    task = asyncio.create_task(operator.run())
    try:
        yield
    finally:
        task.cancel()
        (ended,) = await asyncio.gather(task, return_exceptions=True)
        assert isinstance(ended, asyncio.CancelledError), ended
        screen.end()


async def test_orders_from_a_pipe_do_not_wait_for_each_other_and_answers_are_said() -> None:
    read, write = os.pipe()
    station, out, lease = Station(), io.StringIO(), Lease()
    screen = Screen(out)
    lease.take("page 2", 0.0)
    with os.fdopen(read) as stdin:
        async with operating(TerminalOperator(station, screen, stdin, lease=lease, clock=FakeClock()), screen):
            os.write(write, b"takeoff\nabort\nland\nnonsense\nquit\n")
            os.close(write)
            await station.ordered(4)
    assert station.orders == [TakeOff(), Abort(), Land(), Quit()]
    assert lease.holder(0.0) == NAME  # a script cannot be asked
    said = out.getvalue()
    assert "abort: zero, then hold" in said
    assert "the vehicle refused" in said
    assert "'nonsense' is not known" in said
    assert "\x1b" not in said  # no display where there is no terminal
    assert station.watchers == []


class Pty:
    """A person's end of a pseudo-terminal: what has been shown, and keys."""

    def __init__(self, station: Station, lease: Lease, clock: FakeClock, *, plain: bool = False) -> None:
        self.person, machine = pty.openpty()
        fcntl.ioctl(machine, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        self._files = os.fdopen(machine, "r"), os.fdopen(os.dup(machine), "w")
        self.screen = Screen(self._files[1])
        self.operator = TerminalOperator(station, self.screen, self._files[0], lease=lease, clock=clock, plain=plain)
        self.shown = Terminal()
        self._plain = plain
        self._more = asyncio.Event()

    def press(self, keys: str) -> None:
        os.write(self.person, keys.encode())

    async def shows(self, *texts: str) -> None:
        async with asyncio.timeout(10):
            while not all(text in "\n".join(self.shown.rows) for text in texts):
                self._more.clear()
                await self._more.wait()

    async def hides(self, text: str) -> None:
        async with asyncio.timeout(10):
            while text in "\n".join(self.shown.rows):
                self._more.clear()
                await self._more.wait()

    def _read(self) -> None:
        self.shown.write(os.read(self.person, 65536).decode(errors="replace"))
        self._more.set()

    async def __aenter__(self) -> Pty:
        asyncio.get_running_loop().add_reader(self.person, self._read)
        self._running = contextlib.AsyncExitStack()
        await self._running.enter_async_context(operating(self.operator, self.screen))
        if not self._plain:  # what is typed before is thrown away
            await self.shows("space or Esc ABORT", "\n>")
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._running.aclose()
        asyncio.get_running_loop().remove_reader(self.person)
        for file in self._files:
            file.close()
        os.close(self.person)


@pytest.fixture(autouse=True)
def _terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)


@pytest.fixture
def clock() -> FakeClock:
    return FakeClock(100.0)


@pytest.fixture
def lease() -> Lease:
    return Lease()


@pytest.fixture
def station(clock: FakeClock) -> Station:
    return Station(now_s=clock.now_s)


async def test_a_person_picks_confirms_and_aborts(station: Station, lease: Lease, clock: FakeClock) -> None:
    async with Pty(station, lease, clock) as terminal:
        await terminal.shows("IDLE", "nobody in control", "space or Esc ABORT")
        station.show()
        terminal.press("c")
        await terminal.shows("things", "2 left, high 40x30 px")
        terminal.press("1")
        await station.ordered(1)
        station.show()
        await terminal.shows("SELECTED", f"{NAME} in control", "0.87")
        terminal.press("f")
        await terminal.shows("> f", "Enter: follow")
        assert station.orders == [SelectCandidate(1)]
        terminal.press("\r")
        await terminal.shows("follow confirmed at 15.0 m", "FOLLOWING", "15.4 m of 15.0 m wanted")
        terminal.press("m\r")
        terminal.press(" ")
        await terminal.shows("abort: zero, then hold", "RELEASED")
    assert station.orders == [SelectCandidate(1), Confirm(), SetMode(FollowMode.PARALLEL), Abort()]


async def test_a_number_shows_first_what_it_would_pick(station: Station, lease: Lease, clock: FakeClock) -> None:
    async with Pty(station, lease, clock) as terminal:
        terminal.press("1")
        await terminal.shows("looking for things", "1 middle")
        assert station.orders == []
        terminal.press("1")
        await station.ordered(1)


async def test_control_is_taken_from_another_only_when_asked_again(
    station: Station, lease: Lease, clock: FakeClock
) -> None:
    lease.take("page 2", clock.now_s())
    async with Pty(station, lease, clock) as terminal:
        terminal.press("]")
        await terminal.shows("page 2 is in control: the same again takes over")
        assert station.orders == []
        terminal.press(" ")  # an abort is everybody's, and no answer
        await station.ordered(1)
        assert lease.holder(clock.now_s()) == "page 2"
        await terminal.hides("the same again takes over")
        terminal.press("]")
        await terminal.shows("the same again takes over")
        terminal.press("]")
        await station.ordered(2)
        assert lease.holder(clock.now_s()) == NAME
    assert station.orders == [Abort(), StepStandoff(1.0)]


async def test_who_stays_away_from_the_keys_loses_control(station: Station, lease: Lease, clock: FakeClock) -> None:
    async with Pty(station, lease, clock) as terminal:
        terminal.press("d\r")
        await terminal.shows(f"{NAME} in control")
        for _ in range(70):
            clock.advance(1.0)
            terminal.operator._view()
        assert lease.holder(clock.now_s()) == ""


async def test_leaving_while_following_wants_to_be_meant(station: Station, lease: Lease, clock: FakeClock) -> None:
    station.base = replace(station.base, state=State.FOLLOWING)
    async with Pty(station, lease, clock) as terminal:
        terminal.press("q\r")
        await terminal.shows("the same again stops, holds and leaves")
        clock.advance(6.0)
        await terminal.hides("the same again")
        terminal.press("quit\r")
        await terminal.shows("the same again")
        assert station.orders == []
        terminal.press("q\r")
        await station.ordered(1)
    assert station.orders == [Quit()]


async def test_a_plain_terminal_gets_lines(station: Station, lease: Lease, clock: FakeClock) -> None:
    async with Pty(station, lease, clock, plain=True) as terminal:
        terminal.press("f")
        terminal.press("\x7fdrop\n")
        await terminal.shows("done")
        assert station.orders == [Deselect()]
        assert "\x1b" not in terminal.shown.getvalue()


async def test_a_terminal_that_takes_nothing_does_not_hold_up_the_end(
    station: Station, lease: Lease, clock: FakeClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(terminal_screen, "_END_S", 60.0)
    person, machine = pty.openpty()
    freed = threading.Event()

    def free() -> None:  # lest the test waits as long as a flight would
        freed.set()
        os.close(person)

    rescue = threading.Timer(3.0, free)
    rescue.start()
    out = os.fdopen(machine, "w")
    screen = Screen(out)
    task = asyncio.create_task(TerminalOperator(station, screen, io.StringIO(), lease=lease, clock=clock).run())
    await asyncio.sleep(0)
    for number in range(2000):  # far more than a terminal buffers
        screen.say(f"{number} " + "x" * 200)
    await asyncio.sleep(0.05)
    task.cancel()
    await asyncio.wait([task])
    assert not freed.is_set()
    rescue.cancel()
    os.close(person)
    screen.end()
    out.close()


async def test_the_terminal_is_left_as_it_was(station: Station, lease: Lease, clock: FakeClock) -> None:
    person, machine = pty.openpty()
    try:
        before = termios.tcgetattr(machine)
        with os.fdopen(os.dup(machine), "r") as stdin:
            screen = Screen(io.StringIO())
            operator = TerminalOperator(station, screen, stdin, lease=lease, clock=clock)
            async with operating(operator, screen):
                await asyncio.sleep(0)
                assert termios.tcgetattr(machine) != before
        assert termios.tcgetattr(machine) == before
    finally:
        os.close(person)
        os.close(machine)

"""The operator at a terminal, or a script on a pipe: keys and lines in, a display and answers out."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Final, TextIO

from rich.color import ColorSystem
from rich.console import COLOR_SYSTEMS, Console

from control.engagement import State
from control.modes import FollowMode
from gcs.audit import Audit
from gcs.clock import Clock, MonotonicClock
from gcs.errors import GcsError
from gcs.flight_control import Tick
from gcs.flight_view import Sighting, Status
from gcs.operator.lease import Lease
from gcs.operator.orders import Abort, Order, OrderError, Quit, SelectCandidate, SetMode
from gcs.operator.station import Station
from gcs.operator.terminal_hud import View, render
from gcs.operator.terminal_keys import Key, Keys, Lines, Typed
from gcs.operator.terminal_screen import Screen
from tracker.box import Box

__all__ = ["NAME", "Screen", "TerminalOperator", "perform"]

NAME: Final = "terminal"  # in the lease
_SHOW_S: Final = 0.25
_ASK_S: Final = 5.0  # for the same order again, which answers a question
_PRESENT_S: Final = 60.0  # after the last key the control is nobody's


@dataclass(frozen=True, slots=True)
class _Question:
    order: Order
    text: str
    until_s: float


class TerminalOperator:
    """Reads standard input on the event loop, performs orders, keeps the display; also a `Watcher` of the station.

    Where input and output are a terminal: single keys and the whole display. Elsewhere, and where plain: whole lines,
    and only what is said. lease: shared with page and camera; a person is asked before it is taken from another, a
    script just takes it.
    """

    def __init__(
        self,
        station: Station,
        screen: Screen,
        stdin: TextIO | None = None,
        *,
        lease: Lease | None = None,
        clock: Clock | None = None,
        plain: bool = False,
    ) -> None:
        self._station, self._screen = station, screen
        self._stdin = stdin if stdin is not None else sys.stdin
        self._lease = lease if lease is not None else Lease()
        self._now_s = (clock or MonotonicClock()).now_s
        self._plain = plain
        self._orders: set[asyncio.Task[None]] = set()
        self._keys: Keys | Lines = Lines()
        self._wake = asyncio.Event()
        self._sighting: Sighting | None = None
        self._state: object = None
        self._question: _Question | None = None
        self._looks_for_things = False
        self._key_s = self._now_s()

    async def run(self) -> None:
        """Until cancelled; the screen is for its owner to end. The end of the input does not end the flight."""
        with _Raw(self._stdin, wanted=not self._plain) as raw:
            if raw.active:
                self._keys = Keys(self._now_s)
            self._screen.start()
            end_watching = self._station.watch(self)
            fd = self._listen()
            try:
                if raw.active and self._screen.is_terminal:
                    await self._show()
                else:
                    await self._show_line()
            finally:
                end_watching()
                if fd is not None:
                    asyncio.get_running_loop().remove_reader(fd)
                self._screen.settle()  # not `end`: a terminal that takes nothing must not hold up the flight's end

    # -- what is seen -------------------------------------------------------------------------------------

    async def _show(self) -> None:
        colours, size = _colours(), self._screen.size
        while True:
            if (now := self._screen.size) != size:
                size = now
                self._screen.repaint()
            self._screen.block(render(self._view(), *size, colours))
            await self._pause(_SHOW_S)

    async def _show_line(self) -> None:
        while True:
            if not self._plain:
                self._screen.live(self._station.status_line())
            await self._pause(2 * _SHOW_S)

    async def _pause(self, most_s: float) -> None:
        """Until something has changed that cannot wait."""
        try:
            async with asyncio.timeout(most_s):
                await self._wake.wait()
        except TimeoutError:
            pass
        self._wake.clear()

    def _view(self) -> View:
        station, now_s = self._station, self._now_s()
        status = station.status()
        if now_s - self._key_s < _PRESENT_S:
            self._lease.renew(NAME, now_s)
        if self._question is not None and now_s > self._question.until_s:
            self._question = None
        looks = self._looks_for_things and not status.is_engaged
        return View(
            status=status,
            size=station.size,
            watermark=station.watermark,
            box=self._box(status),
            refusals=station.refusals() if status.state is State.SELECTED else (),
            candidates=station.candidates() if looks else None,
            controller=self._lease.holder(now_s),
            typed=self._keys.line,
            asked=self._question.text if self._question is not None else "",
        )

    def _box(self, status: Status) -> Box | None:
        if self._sighting is None or self._sighting.seen.selection != status.selection:
            return None
        result = self._sighting.seen.result
        return result.box if result is not None and result.visible else None

    def saw(self, sighting: Sighting) -> None:
        """Where the target is."""
        self._sighting = sighting

    def ticked(self, tick: Tick) -> None:
        """A new state is shown at once."""
        state = tick.output.state, tick.output.engaging, tick.output.reasons
        if state != self._state:
            self._state = state
            self._wake.set()

    def audited(self, t_s: float, audit: Audit) -> None:
        """The flight says it."""

    # -- what is typed ------------------------------------------------------------------------------------

    def _listen(self) -> int | None:
        try:
            fd = self._stdin.fileno()
        except (OSError, ValueError):
            return None
        try:
            asyncio.get_running_loop().add_reader(fd, self._readable, fd)
        except PermissionError:  # a regular file: always ready, never waited for
            while self._read(fd):
                pass
            return None
        return fd

    def _readable(self, fd: int) -> None:
        if not self._read(fd):
            asyncio.get_running_loop().remove_reader(fd)

    def _read(self, fd: int) -> bool:
        """Perform what stands in the input; False at its end."""
        try:
            data = os.read(fd, 4096)
        except OSError:
            return False
        self._key_s = self._now_s()
        for typed in self._keys.feed(data.decode("utf-8", "replace")):
            self._obey(typed)
        self._wake.set()
        return bool(data)

    def _obey(self, typed: Typed) -> None:
        match typed:
            case OrderError():
                self._screen.say(str(typed))
            case Key.REDRAW:
                self._screen.repaint()
            case Key.CANDIDATES:
                self._looks_for_things = not self._looks_for_things
            case Key.MODE:
                modes = list(FollowMode)
                held = modes.index(self._station.status().follow_mode)
                self._order(SetMode(modes[(held + 1) % len(modes)]))
            case SelectCandidate() if isinstance(self._keys, Keys) and not self._looks_for_things:
                self._looks_for_things = True
                self._screen.say("looking for things that move: press the number of one that is listed")
            case _:
                self._order(typed)

    def _order(self, order: Order) -> None:
        """Start it, or ask first: whoever is at the machine may take control, but not without knowing of the other."""
        if isinstance(order, Abort):
            self._question = None
            self._start(order)
            return
        now_s, asked = self._now_s(), self._question
        self._question = None
        sure = isinstance(self._keys, Lines) or (asked is not None and asked.order == order and now_s <= asked.until_s)
        question = None if sure else self._doubt(order, now_s)
        if question is not None:
            self._question = _Question(order, question, now_s + _ASK_S)
            if not self._screen.is_terminal:
                self._screen.say(question)
            return
        if not isinstance(order, Quit):
            self._lease.take(NAME, now_s, by_force=True)
        self._start(order)

    def _doubt(self, order: Order, now_s: float) -> str | None:
        """What the operator has to be asked before."""
        holder = self._lease.holder(now_s)
        if isinstance(order, Quit):
            return "a target is being followed: the same again stops, holds and leaves" if self._is_engaged() else None
        if holder not in ("", NAME):
            return f"{holder} is in control: the same again takes over"
        return None

    def _is_engaged(self) -> bool:
        return self._station.status().is_engaged

    def _start(self, order: Order) -> None:
        # Each order is its own task: an abort never waits for a take-off to end.
        task = asyncio.get_running_loop().create_task(perform(self._station.perform(order), self._screen.say))
        self._orders.add(task)
        task.add_done_callback(self._orders.discard)


async def perform(answer: Awaitable[str], say: Callable[[str], None]) -> None:
    """Say the answer of an order, or why it was not done."""
    try:
        text = await answer
    except (GcsError, ValueError) as error:
        text = str(error)
    if text:
        say(text)


def _colours() -> ColorSystem | None:
    """What the terminal can show; None: no colours, by NO_COLOR or because it has none."""
    console = Console(force_terminal=True)
    return None if console.no_color or console.color_system is None else COLOR_SYSTEMS[console.color_system]


class _Raw:
    """The terminal without line editing and echo while it lasts; nothing for a pipe, or where not wanted."""

    def __init__(self, stream: TextIO, *, wanted: bool = True) -> None:
        self.active = False
        self._wanted = wanted and os.environ.get("TERM") != "dumb"
        self._stream = stream
        self._saved: list[object] | None = None

    def __enter__(self) -> _Raw:
        if not self._wanted or not self._stream.isatty():
            return self
        try:
            import termios
            import tty
        except ImportError:  # not a POSIX system: lines only
            return self
        fd = self._stream.fileno()
        self._saved = list(termios.tcgetattr(fd))
        tty.setcbreak(fd)  # Ctrl-C still is a signal
        mode = termios.tcgetattr(fd)
        mode[0] &= ~termios.IXON  # Ctrl-S would stop the display
        mode[6][termios.VSUSP] = b"\0"  # Ctrl-Z would stop the flight
        termios.tcsetattr(fd, termios.TCSADRAIN, mode)
        self.active = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._saved is not None:
            import termios

            termios.tcsetattr(self._stream.fileno(), termios.TCSANOW, self._saved)  # type: ignore[arg-type]

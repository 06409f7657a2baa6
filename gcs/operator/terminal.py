"""The operator at a terminal, or a script on a pipe: keys and lines in, a live line and answers out."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
from collections.abc import Awaitable, Callable, Iterator
from types import TracebackType
from typing import Final, Protocol, TextIO

from gcs.errors import GcsError
from gcs.operator.orders import Abort, Confirm, Order, OrderError, Quit, parse_order

_ESCAPE: Final = "\x1b"
_BACKSPACE: Final = ("\x7f", "\b")
_SHOW_S = 0.5
_MAX_LINE = 200
KEYS = "f follow · space or Esc abort · q quit · or type an order and Enter"


class Flying(Protocol):
    """The flight as an operator sees it."""

    async def perform(self, order: Order) -> str:
        """Do it; the answer for the operator. GcsError or OrderError with the reason if not."""
        ...

    def status_line(self) -> str:
        """The state of everything in one line."""
        ...


class Keys:
    """Single keys act at once while nothing is typed; everything else is a line that ends with Enter."""

    def __init__(self) -> None:
        self.line = ""

    def feed(self, text: str) -> Iterator[Order | OrderError]:
        """Orders of what was typed since; Escape aborts whatever stands in the line."""
        if text.startswith(_ESCAPE) and len(text) > 1:
            return  # an arrow or function key
        for char in text:
            order = self._key(char)
            if order is not None:
                yield order

    def _key(self, char: str) -> Order | OrderError | None:
        if char == _ESCAPE or (char == " " and not self.line):
            self.line = ""
            return Abort()
        if not self.line and char in "fF":
            return Confirm()
        if not self.line and char in "qQ":
            return Quit()
        if char in "\r\n":
            line, self.line = self.line, ""
            return parse(line) if line.strip() else None
        if char in _BACKSPACE:
            self.line = self.line[:-1]
        elif char.isprintable() and len(self.line) < _MAX_LINE:
            self.line += char
        return None


class Lines:
    """Whole lines, as from a pipe or a file."""

    def __init__(self) -> None:
        self.line = ""

    def feed(self, text: str) -> Iterator[Order | OrderError]:
        """Orders of the lines completed by this text."""
        *whole, rest = (self.line + text).split("\n")
        self.line = rest[-_MAX_LINE:]
        for line in whole:
            if line.strip():
                yield parse(line)


def parse(line: str) -> Order | OrderError:
    """The order, or what is wrong with it."""
    try:
        return parse_order(line)
    except OrderError as error:
        return error


class Screen:
    """Answers on lines of their own; on a terminal one live line below them, elsewhere none."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self.is_terminal = not out.closed and out.isatty()
        self._live = ""

    def say(self, text: str) -> None:
        """One line that stays."""
        self._write(("\r\x1b[K" if self.is_terminal else "") + text + "\n" + self._live)

    def live(self, text: str) -> None:
        """Replace the live line; nothing where the output is no terminal."""
        if self.is_terminal:
            self._live = text[: _columns(self._out) - 1]
            self._write("\r\x1b[K" + self._live)

    def end(self) -> None:
        """Leave the live line behind."""
        if self._live:
            self._live = ""
            self._write("\n")

    def _write(self, text: str) -> None:
        with contextlib.suppress(OSError, ValueError):  # a closed pipe or terminal must not end a flight
            self._out.write(text)
            self._out.flush()


def _columns(out: TextIO) -> int:
    try:
        return max(20, os.get_terminal_size(out.fileno()).columns)
    except (OSError, ValueError):
        return 80


class TerminalOperator:
    """Reads standard input on the event loop, performs orders, keeps the live line."""

    def __init__(self, flight: Flying, screen: Screen, stdin: TextIO | None = None) -> None:
        self._flight = flight
        self._screen = screen
        self._stdin = stdin if stdin is not None else sys.stdin
        self._orders: set[asyncio.Task[None]] = set()
        self._keys: Keys | Lines = Lines()
        self._bytes = b""

    async def run(self) -> None:
        """Until cancelled. The end of the input does not end the flight."""
        with _Raw(self._stdin) as raw:
            self._keys = Keys() if raw.active else Lines()
            if raw.active:
                self._screen.say(KEYS)
            fd = self._listen()
            try:
                while True:
                    typed = f"  > {self._keys.line}" if raw.active and self._keys.line else ""
                    self._screen.live(self._flight.status_line() + typed)
                    await asyncio.sleep(_SHOW_S if not typed else 0.1)
            finally:
                if fd is not None:
                    asyncio.get_running_loop().remove_reader(fd)
                self._screen.end()

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
        for order in self._keys.feed(data.decode("utf-8", "replace")):
            if isinstance(order, OrderError):
                self._screen.say(str(order))
            else:
                self._start(order)
        return bool(data)

    def _start(self, order: Order) -> None:
        # Each order is its own task: an abort never waits for a take-off to end.
        task = asyncio.get_running_loop().create_task(perform(self._flight.perform(order), self._screen.say))
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


class _Raw:
    """The terminal without line editing and echo while it lasts; nothing for a pipe."""

    def __init__(self, stream: TextIO) -> None:
        self.active = False
        self._stream = stream
        self._saved: list[object] | None = None

    def __enter__(self) -> _Raw:
        if not self._stream.isatty():
            return self
        try:
            import termios
            import tty
        except ImportError:  # not a POSIX system: lines only
            return self
        fd = self._stream.fileno()
        self._saved = list(termios.tcgetattr(fd))
        tty.setcbreak(fd)  # Ctrl-C still is a signal
        self.active = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._saved is not None:
            import termios

            termios.tcsetattr(self._stream.fileno(), termios.TCSADRAIN, self._saved)  # type: ignore[arg-type]

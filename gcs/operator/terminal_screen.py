"""Where answers and the display are written: lines that stay, and below them a block that is painted over.

While somebody types (`start` to `end`) all writing is done by a thread, for a terminal can stop taking what is written
(a radio link, a stopped pager) and the flight's loop must not wait for it. Of live lines only the newest are written.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import threading
from collections import deque
from typing import Final, TextIO

_RECENT: Final = 6  # said again after the window's size has changed
_MOST_WAITING: Final = 1000
_END_S: Final = 2.0


class Screen:
    """Answers on lines of their own; on a terminal a block of live lines below them, elsewhere none."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self.is_terminal = not out.closed and out.isatty() and os.environ.get("TERM") != "dumb"
        self._said: deque[str] = deque(maxlen=_MOST_WAITING)
        self._recent: deque[str] = deque(maxlen=_RECENT)
        self._block: list[str] = []
        self._painted: list[str] = []
        self._anew = False
        self._settled = ""  # a display that is left behind, and what was said before that
        self._change = threading.Condition()
        self._thread: threading.Thread | None = None
        self._ending = False

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows."""
        try:
            columns, rows = os.get_terminal_size(self._out.fileno())
        except (OSError, ValueError):
            columns, rows = shutil.get_terminal_size()
        return max(columns or 80, 20), max(rows or 24, 4)  # a serial line says 0

    def say(self, text: str) -> None:
        """A line that stays."""
        if self.is_terminal:  # what a vehicle sends must not steer the terminal
            text = "".join(char if char.isprintable() or char == "\n" else " " for char in text)
        with self._change:
            self._said.append(text)
            self._recent.append(text)
        self._changed()

    def live(self, text: str) -> None:
        """One live line; nothing where the output is no terminal."""
        self.block([text[: self.size[0] - 1]])

    def block(self, lines: list[str]) -> None:
        """Replace the live lines, none wider than the terminal less one; nothing where the output is no terminal."""
        if self.is_terminal:
            with self._change:
                self._block = list(lines)
            self._changed()

    def repaint(self) -> None:
        """Everything anew: the window has another size, or somebody has written into it."""
        if self.is_terminal:
            with self._change:
                self._anew = True
            self._changed()

    def start(self) -> None:
        """From now on a thread writes."""
        self._ending = False
        self._thread = threading.Thread(target=self._run, name="screen", daemon=True)
        self._thread.start()

    def settle(self) -> None:
        """Leave the live lines behind: what comes later stands below them."""
        if self.is_terminal:
            with self._change:
                self._settled = self._due() + ("\n" if self._painted else "")
                self._block, self._painted = [], []
        self._changed()

    def end(self) -> None:
        """The live lines are left behind, and what comes later is written at once again. Waits for a slow terminal."""
        thread, self._thread = self._thread, None
        if thread is not None:
            with self._change:
                self._ending = True
                self._change.notify()
            thread.join(_END_S)
            if thread.is_alive():  # the terminal takes nothing: it would not take the rest either
                return
        self.settle()

    def _changed(self) -> None:
        if self._thread is None:
            self._write(self._due())
        else:
            with self._change:
                self._change.notify()

    def _run(self) -> None:
        while not self._ending:
            with self._change:
                if not (self._said or self._anew or self._settled or self._block != self._painted or self._ending):
                    self._change.wait()
            self._write(self._due())

    def _due(self) -> str:
        """What has to be written for everything said and the block to stand there."""
        with self._change:
            settled, said, block, anew = self._settled, list(self._said), self._block, self._anew
            self._said.clear()
            self._settled, self._anew = "", False
            if not self.is_terminal:
                return "".join(text + "\n" for text in said)
            painted, self._painted = self._painted, block
            if anew:
                return "\x1b[H\x1b[2J" + "".join(text + "\n" for text in self._recent) + "\n".join(block)
        if said or len(block) != len(painted):
            return settled + _to_top(painted) + "".join(text + "\n" for text in said) + "\n".join(block)
        return settled + _difference(painted, block)

    def _write(self, text: str) -> None:
        if text:
            with contextlib.suppress(OSError, ValueError):  # a closed pipe or terminal must not end a flight
                self._out.write(text)
                self._out.flush()


def _to_top(painted: list[str]) -> str:
    if not painted:
        return ""
    up = f"\x1b[{len(painted) - 1}A" if len(painted) > 1 else ""
    return f"\r{up}\x1b[J"


def _difference(painted: list[str], block: list[str]) -> str:
    """Only the lines that changed, from the last one's end back to it: nothing flickers, and a radio carries it."""
    if block == painted:
        return ""
    parts, last = [], len(block) - 1
    for index, line in enumerate(block[:-1]):
        if line != painted[index]:
            parts.append(f"\x1b[{last - index}A\r{line}\x1b[K\x1b[{last - index}B")
    return "".join(parts) + f"\r{block[last]}\x1b[K"

"""What the operator types: keys that act at once, letters and lines that want Enter."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from enum import Enum
from types import MappingProxyType
from typing import Final, TypeAlias

from gcs.operator.orders import (
    Abort,
    Acknowledge,
    Confirm,
    Deselect,
    Order,
    OrderError,
    Quit,
    Record,
    SelectCandidate,
    StepStandoff,
    parse_order,
)

ABORT_KEYS: Final = "space or Esc"
LINE_S: Final = 5.0  # a line without a key for so long is forgotten: an Enter much later must not confirm it
_ESCAPE: Final = "\x1b"
_FUNCTION_KEY = re.compile(r"\x1b(?:\[[0-9;?<]*[ -/]*[@-~]|O[ -~])")  # arrows and the like, as terminals send them
_BACKSPACE: Final = ("\x7f", "\b")
_MAX_LINE: Final = 200
_STEP_M: Final = 1.0


class Key(Enum):
    """What only the display can answer."""

    MODE = "the next mode"
    CANDIDATES = "show or hide the candidates"
    REDRAW = "paint everything anew"


Typed: TypeAlias = Order | OrderError | Key

_AT_ONCE: Mapping[str, Order | Key] = MappingProxyType(
    {
        "[": StepStandoff(-_STEP_M),
        "]": StepStandoff(_STEP_M),
        "c": Key.CANDIDATES,
        "\x0c": Key.REDRAW,
        **{str(number): SelectCandidate(number) for number in range(1, 10)},
    }
)
# With Enter: every one of these also begins a word, and a follow must be meant.
_SHORT: Mapping[str, Order | Key] = MappingProxyType(
    {"f": Confirm(), "q": Quit(), "d": Deselect(), "a": Acknowledge(), "r": Record(), "m": Key.MODE}
)


class Keys:
    """Escape aborts always, space unless an order is being typed; digits, [ ] and c act at once, the rest with Enter.

    now_s: the time; what was begun LINE_S before is forgotten.
    """

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._line = ""
        self._typed_s = 0.0

    @property
    def line(self) -> str:
        """What has been typed and not yet entered."""
        if self._line and self._now_s() - self._typed_s > LINE_S:
            self._line = ""
        return self._line

    def feed(self, text: str) -> Iterator[Typed]:
        """What was meant by what was typed since."""
        for char in _FUNCTION_KEY.sub("", text):
            meant = self._key(char)
            if meant is not None:
                yield meant

    def _key(self, char: str) -> Typed | None:
        line = self.line
        self._typed_s = self._now_s()
        if char == _ESCAPE or (char == " " and len(line) < 2):
            self._line = ""
            return Abort()
        if not line and char.lower() in _AT_ONCE:
            return _AT_ONCE[char.lower()]
        if char in "\r\n":
            self._line = ""
            return meant_by(line) if line.strip(" :") else None
        if char in _BACKSPACE:
            self._line = line[:-1]
        elif char.isprintable() and len(line) < _MAX_LINE:
            self._line = line + char
        return None


def meant_by(line: str) -> Typed:
    """Of a line typed at the terminal: one letter, or the words of an order, which a colon may come before."""
    words = line.strip().removeprefix(":").strip()
    return _SHORT[words.lower()] if words.lower() in _SHORT else parse(words)


class Lines:
    """Whole lines, as from a pipe or a file."""

    line = ""

    def __init__(self) -> None:
        self._rest = ""

    def feed(self, text: str) -> Iterator[Typed]:
        """Orders of the lines completed by this text."""
        *whole, rest = (self._rest + text).split("\n")
        self._rest = rest[-_MAX_LINE:]
        for line in whole:
            if line.strip():
                yield parse(line)


def parse(line: str) -> Order | OrderError:
    """The order, or what is wrong with it."""
    try:
        return parse_order(line)
    except OrderError as error:
        return error

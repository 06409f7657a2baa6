"""Enough of a terminal to know what a person would see."""

from __future__ import annotations

import io
import re

_SEQUENCES = re.compile(r"\x1b\[[\d;]*m|\x1b\[(\d*[A-Z])|(.)", re.DOTALL)


class Terminal(io.StringIO):
    """A stream that claims to be a terminal and knows what one would show."""

    def __init__(self) -> None:
        super().__init__()
        self.rows = [""]
        self._row = self._column = 0

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        for sequence, plain in _SEQUENCES.findall(text):
            if sequence:
                self._control(int(sequence[:-1] or 1), sequence[-1])
            elif plain == "\n":
                self._row, self._column = self._row + 1, 0
                self.rows += [""] * (self._row + 1 - len(self.rows))
            elif plain == "\r":
                self._column = 0
            elif plain:
                row = self.rows[self._row].ljust(self._column)
                self.rows[self._row] = row[: self._column] + plain + row[self._column + 1 :]
                self._column += 1
        return super().write(text)

    def _control(self, number: int, what: str) -> None:
        if what == "A":
            self._row -= number
            assert self._row >= 0, "above the top"
        elif what == "B":
            self._row += number
            assert self._row < len(self.rows), "below the end"
        elif what == "K":
            self.rows[self._row] = self.rows[self._row][: self._column]
        elif what == "J" and number == 2:
            self.rows = [""]  # the cursor was sent home before
        elif what == "J":
            self.rows[self._row :] = [self.rows[self._row][: self._column]]
        elif what == "H":
            self._row = self._column = 0
        else:
            raise AssertionError(what)

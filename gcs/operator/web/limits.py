"""What one client may do: so many messages, so many wrong tokens, and a confirmation only after the button was held.

Pure.
"""

from __future__ import annotations

from typing import Final

HELD_S: Final = (0.9, 5.0)  # the page confirms after 1 s; what was pressed longer ago was not meant for this
_PER_S: Final = 100.0
_AT_ONCE: Final = 300.0
_GUESSES: Final = 10.0  # wrong tokens at once
_GUESS_S: Final = 6.0  # and then one in so long
_MOST_ADDRESSES: Final = 1000


class Flood:
    """A hundred messages a second for ever, three hundred at once."""

    def __init__(self, now_s: float) -> None:
        self._left, self._t_s = _AT_ONCE, now_s

    def is_over(self, now_s: float) -> bool:
        """Note one message; True: that is too many."""
        self._left = min(_AT_ONCE, self._left + (now_s - self._t_s) * _PER_S) - 1.0
        self._t_s = now_s
        return self._left < 0


class Guesses:
    """Wrong tokens of each address; the same one again, as of a page that was left open, is no new guess."""

    def __init__(self) -> None:
        self._wrong: dict[str, tuple[float, float, str | None]] = {}  # how many, when, and the last

    def note(self, address: str, token: str, now_s: float) -> None:
        """This one was wrong."""
        count = self._count(address, now_s)
        _, _, last = self._wrong.pop(address, (0.0, now_s, None))
        self._wrong[address] = count + (token != last), now_s, token
        while len(self._wrong) > _MOST_ADDRESSES:
            del self._wrong[next(iter(self._wrong))]

    def wait_s(self, address: str, now_s: float) -> float:
        """How long this address has to wait until a token of it is looked at again."""
        return max(0.0, (self._count(address, now_s) + 1 - _GUESSES) * _GUESS_S)

    def _count(self, address: str, now_s: float) -> float:
        count, then_s, _ = self._wrong.get(address, (0.0, now_s, None))
        return max(0.0, count - (now_s - then_s) / _GUESS_S)


class HoldToConfirm:
    """Whether confirmation's button was held for this selection by this one client; one hold confirms once."""

    def __init__(self) -> None:
        self._begun: tuple[float, int] | None = None

    def begin(self, now_s: float, selection: int) -> None:
        """Pressed, while this selection was tracked."""
        self._begun = (now_s, selection)

    def end(self) -> None:
        """Let go, or no longer in control."""
        self._begun = None

    def use(self, now_s: float, selection: int) -> str:
        """Empty: held as long as it takes, for this selection; else why not. Either way it has to be pressed anew."""
        begun, self._begun = self._begun, None
        if begun is None:
            return "hold the button for a second to confirm"
        held_s = now_s - begun[0]
        if held_s < HELD_S[0]:
            return f"held for {held_s:.1f} s only: hold the button for a second to confirm"
        if held_s > HELD_S[1]:
            return f"pressed {held_s:.0f} s ago: let go, and hold the button again"
        if begun[1] != selection:
            return "another target has been selected meanwhile: hold the button again"
        return ""

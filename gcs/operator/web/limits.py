"""What one client may do: so many messages, and a confirmation only after the button was held. Pure."""

from __future__ import annotations

from typing import Final

HELD_S: Final = (0.9, 5.0)  # the page confirms after 1 s; what was pressed longer ago was not meant for this
_PER_S: Final = 100.0
_AT_ONCE: Final = 300.0


class Flood:
    """A hundred messages a second for ever, three hundred at once."""

    def __init__(self, now_s: float) -> None:
        self._left, self._t_s = _AT_ONCE, now_s

    def is_over(self, now_s: float) -> bool:
        """Note one message; True: that is too many."""
        self._left = min(_AT_ONCE, self._left + (now_s - self._t_s) * _PER_S) - 1.0
        self._t_s = now_s
        return self._left < 0


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

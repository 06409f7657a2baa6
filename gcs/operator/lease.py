"""Who is in control: several may look, one at a time may order. An abort is everybody's."""

from __future__ import annotations

from typing import Final

LEASE_S: Final = 5.0  # unheard for so long, the holder has left


class Lease:
    """One for a station, shared by page, MAVLink camera and terminal; names are shown to people."""

    def __init__(self) -> None:
        self._holder = ""
        self._heard_s = 0.0

    def holder(self, now_s: float) -> str:
        """Who is in control; empty: nobody."""
        return self._holder if self._holder and now_s - self._heard_s <= LEASE_S else ""

    def take(self, name: str, now_s: float, *, by_force: bool = False) -> bool:
        """Become the one in control: where nobody is, or by force. Also keeps what one has."""
        if self.holder(now_s) not in ("", name) and not by_force:
            return False
        self._holder, self._heard_s = name, now_s
        return True

    def renew(self, name: str, now_s: float) -> bool:
        """Still here; False: somebody else has taken over, or the lease ran out."""
        if self.holder(now_s) != name:
            return False
        self._heard_s = now_s
        return True

    def release(self, name: str) -> None:
        """Control is free for the next."""
        if self._holder == name:
            self._holder = ""

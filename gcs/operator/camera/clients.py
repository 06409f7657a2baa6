"""Who has been heard lately, and what each wants to be told how often. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from gcs.transport import Peer

MOST_CLIENTS: Final = 16
MOST_OF_HOST: Final = 8
SILENT_S: Final = 10.0  # unheard for so long, a client has left
_QUIET_S: Final = 3.0  # and may make room for another
FASTEST_S: Final = 0.02


@dataclass(frozen=True, slots=True)
class Client:
    """Who speaks: from which address (None: there is only one), and as which MAVLink component."""

    peer: Peer | None
    system_id: int
    component_id: int

    @property
    def name(self) -> str:
        """For people."""
        name = f"camera {self.system_id}/{self.component_id}"  # every QGroundControl calls itself 255/190
        return name if self.peer is None else f"{name} at {self.peer[0]}:{self.peer[1]}"


@dataclass(slots=True)
class _Known:
    heard_s: float
    period_s: dict[int, float] = field(default_factory=dict)  # by message id
    wants_parameters: bool = False


class Clients:
    """A bounded number, of each host too; who is heard keeps its place: a flood of addresses displaces nobody."""

    def __init__(self) -> None:
        self._known: dict[Client, _Known] = {}
        self._due_s: dict[tuple[Peer | None, int], float] = {}

    def heard(self, client: Client, now_s: float) -> bool:
        """It spoke; False: there are too many already."""
        known = self._known.get(client)
        if known is not None:
            known.heard_s = now_s
            return True
        rivals = [each for each in self._known if client.peer and each.peer and each.peer[0] == client.peer[0]]
        if len(rivals) < MOST_OF_HOST:
            rivals = list(self._known) if len(self._known) >= MOST_CLIENTS else []
        if rivals:
            quietest = min(rivals, key=lambda each: self._known[each].heard_s)
            if now_s - self._known[quietest].heard_s < _QUIET_S:
                return False
            del self._known[quietest]
        self._known[client] = _Known(now_s)
        return True

    @property
    def heard_s(self) -> float:
        """When any of them was heard last."""
        return max((known.heard_s for known in self._known.values()), default=-math.inf)

    def names(self) -> set[str]:
        """As which they may be in control."""
        return {client.name for client in self._known}

    def knows(self, peer: Peer | None) -> bool:
        """A client speaks from there."""
        return any(client.peer == peer for client in self._known)

    def forget_silent(self, now_s: float) -> None:
        """Those who have left."""
        self._known = {client: known for client, known in self._known.items() if now_s - known.heard_s <= SILENT_S}
        peers = self.peers()
        self._due_s = {key: due_s for key, due_s in self._due_s.items() if key[0] in peers}

    def peers(self) -> tuple[Peer | None, ...]:
        """The addresses, each once."""
        return tuple(dict.fromkeys(client.peer for client in self._known))

    def follow_parameters(self, client: Client) -> None:
        """It has asked for the parameters: tell it of changes."""
        if client in self._known:
            self._known[client].wants_parameters = True

    def parameter_peers(self) -> tuple[Peer | None, ...]:
        """The addresses of those who have."""
        return tuple(dict.fromkeys(client.peer for client, known in self._known.items() if known.wants_parameters))

    def want(self, client: Client, message_id: int, period_s: float | None, now_s: float) -> None:
        """Tell it this every so often, from now on; None: no more."""
        known = self._known.get(client)
        if known is None:
            return
        if period_s is None:
            known.period_s.pop(message_id, None)
        else:
            known.period_s[message_id] = max(period_s, FASTEST_S)
            self._due_s[client.peer, message_id] = now_s

    def period_s(self, client: Client, message_id: int) -> float | None:
        """What it wants; None: nothing."""
        known = self._known.get(client)
        return None if known is None else known.period_s.get(message_id)

    def due(self, now_s: float) -> list[tuple[Peer | None, int]]:
        """What is to be sent now, and where. Clients behind one address get what the most eager of them wants."""
        found = []
        for key, period_s in self._periods().items():
            due_s = self._due_s.get(key, now_s)
            if now_s >= due_s:
                found.append(key)
                due_s += period_s
                self._due_s[key] = due_s if due_s > now_s else now_s + period_s
        return found

    @property
    def due_s(self) -> float:
        """When the next is to be sent; infinity: nothing is wanted."""
        return min((self._due_s.get(key, -math.inf) for key in self._periods()), default=math.inf)

    def _periods(self) -> dict[tuple[Peer | None, int], float]:
        periods: dict[tuple[Peer | None, int], float] = {}
        for client, known in self._known.items():
            for message_id, period_s in known.period_s.items():
                key = client.peer, message_id
                periods[key] = min(period_s, periods.get(key, math.inf))
        return periods

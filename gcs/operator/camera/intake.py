"""Datagrams into the few messages a camera reads, at a bounded cost: anybody may send to an open port. No I/O."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Final

from gcs.framing import Deframer, Message, message_id, split_frames
from gcs.transport import Peer

# HEARTBEAT, COMMAND_INT, COMMAND_LONG, PARAM_EXT_REQUEST_READ, _LIST and _SET: telemetry that a router sends along
# is not even decoded.
_READ: Final = frozenset({0, 75, 76, 320, 321, 323})
_MOST_BYTES: Final = 2048  # of a datagram: more than a network passes on in one piece
_MOST_FRAMES: Final = 8  # of a datagram that are read; each costs about 0.1 ms
_MOST_GARBAGE_BYTES: Final = 300  # one message; each byte of rubbish may look like the beginning of one
_MOST_KEPT: Final = 256


@dataclass(frozen=True, slots=True)
class Allowance:
    """Datagrams that are looked into: so many at once, and so many a second."""

    at_once: float
    per_s: float


KNOWN: Final = Allowance(50, 200)  # of each client
STRANGE: Final = Allowance(20, 50)  # of each host from which no client is known
ALL_STRANGE: Final = Allowance(60, 200)


class Intake:
    """Beyond its limits it drops what comes; clients that are known do not suffer from a flood of others."""

    def __init__(self) -> None:
        self._deframer = Deframer()
        self._left: dict[Hashable, tuple[float, float]] = {}  # how many may be looked into, and when that was
        self.dropped = 0

    def messages(self, data: bytes, peer: Peer | None, now_s: float, *, known: bool) -> list[Message]:
        """What is worth reading in this datagram. known: its sender is a client, or the only one there can be."""
        frames = split_frames(data) if len(data) <= _MOST_BYTES else []
        if frames is None:
            wanted = [data] if len(data) <= _MOST_GARBAGE_BYTES else []
        else:
            wanted = [frame for frame in frames if message_id(frame) in _READ][:_MOST_FRAMES]
        if not wanted or not self._may_look(peer, now_s, known):
            return []
        return [message for frame in wanted for message in self._deframer.datagram(frame)]

    def _may_look(self, peer: Peer | None, now_s: float, known: bool) -> bool:
        if known or peer is None:
            may = self._take(peer, KNOWN, now_s)
        else:
            may = self._take(peer[0], STRANGE, now_s) and self._take("all", ALL_STRANGE, now_s)
        self.dropped += not may
        return may

    def _take(self, key: Hashable, allowance: Allowance, now_s: float) -> bool:
        left, then_s = self._left.pop(key, (allowance.at_once, now_s))
        left = min(allowance.at_once, left + max(0.0, now_s - then_s) * allowance.per_s)
        self._left[key] = (left - 1 if left >= 1 else left), now_s
        while len(self._left) > _MOST_KEPT:
            del self._left[next(iter(self._left))]
        return left >= 1

"""Datagrams into the few messages a camera reads, at a bounded cost: anybody may send to an open port. No I/O."""

from __future__ import annotations

from typing import Final

from gcs.framing import Deframer, Message, message_id, split_frames
from gcs.transport import Peer

# HEARTBEAT, COMMAND_INT, COMMAND_LONG, PARAM_EXT_REQUEST_READ, _LIST and _SET: telemetry that a router sends along
# is not even decoded.
_READ: Final = frozenset({0, 75, 76, 320, 321, 323})
_WINDOW_S: Final = 1.0
MOST: Final = 400  # datagrams in a window that are looked into; each costs about 0.1 ms
MOST_OF_ONE: Final = 200


class Intake:
    """Beyond its limits it drops what comes."""

    def __init__(self) -> None:
        self._deframer = Deframer()
        self._since_s = 0.0
        self._looked_into: dict[Peer | None, int] = {}
        self.dropped = 0

    def messages(self, data: bytes, peer: Peer | None, now_s: float) -> list[Message]:
        """What is worth reading in this datagram."""
        frames = split_frames(data)
        wanted = [data] if frames is None else [frame for frame in frames if message_id(frame) in _READ]
        if not wanted or not self._may_look(peer, now_s):
            return []
        return [message for frame in wanted for message in self._deframer.datagram(frame)]

    def _may_look(self, peer: Peer | None, now_s: float) -> bool:
        if not 0.0 <= now_s - self._since_s < _WINDOW_S:
            self._since_s, self._looked_into = now_s, {}
        looked_into = self._looked_into.get(peer, 0)
        if looked_into >= MOST_OF_ONE or sum(self._looked_into.values()) >= MOST:
            self.dropped += 1
            return False
        self._looked_into[peer] = looked_into + 1
        return True

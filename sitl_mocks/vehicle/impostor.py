"""Someone on the wire who has no key: sends recorded frames again, and frames with a forged address."""

from __future__ import annotations

import random
from collections import deque
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

_KEPT = 500


@dataclass(slots=True)
class Impostor:
    """Hears datagrams with `hear`; both kinds of attack are seeded."""

    system_id: int
    component_id: int
    random: random.Random
    sent: int = 0
    _heard: deque[bytes] = field(default_factory=lambda: deque(maxlen=_KEPT))
    _codec: Any = None

    def hear(self, datagram: bytes) -> None:
        """Record a genuine datagram."""
        self._heard.append(datagram)

    def replay(self) -> bytes | None:
        """A genuine datagram from before, None before the first."""
        if not self._heard:
            return None
        self.sent += 1
        return self.random.choice(self._heard)

    def forge(self, message: Any, timestamp: int | None = None) -> bytes:
        """The message under the vehicle's address, signed with a wrong key at a time stamp; None: not signed."""
        if self._codec is None:
            self._codec = mavlink.MAVLink(None, self.system_id, self.component_id)
            self._codec.signing.secret_key = self.random.randbytes(32)
        signing = self._codec.signing
        signing.sign_outgoing = timestamp is not None
        signing.timestamp = timestamp or 0
        self._codec.seq = (self._codec.seq + 1) % 256
        self.sent += 1
        return bytes(message.pack(self._codec))

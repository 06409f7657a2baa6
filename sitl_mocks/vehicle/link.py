"""Framing of the mock vehicle: datagrams to messages, messages to datagrams at their due times."""

from __future__ import annotations

import heapq
import itertools
import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.vehicle.autopilot import Text

_TEXT_BYTES = 50


def decode_datagram(datagram: bytes) -> Iterator[Any]:
    """The well-formed messages of one datagram; a broken one cannot swallow those of the next."""
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    for message in parser.parse_buffer(bytearray(datagram)) or ():
        if message.get_msgId() >= 0 and not message.get_type().startswith("UNKNOWN_"):
            yield message


@dataclass(slots=True)
class Outbox:
    """Messages waiting for their time; `flush` packs those that are due as one vehicle component."""

    system_id: int
    component_id: int
    random: random.Random
    _queue: list[tuple[float, int, Any]] = field(default_factory=list)
    _order: Iterator[int] = field(default_factory=itertools.count)
    _packer: Any = field(init=False)
    _ack_t_s: float = field(init=False, default=0.0)
    _text_id: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self._packer = mavlink.MAVLink(None, self.system_id, self.component_id)

    def put(self, message: Any, due_s: float) -> None:
        """Send at due_s or at the first flush after it, in the order of the due times."""
        heapq.heappush(self._queue, (due_s, next(self._order), message))

    def answer_time_s(self, now_s: float) -> float:
        """When an answer asked for now goes out: 1 to 25 ms later, one at a time (measured on PX4)."""
        self._ack_t_s = max(self._ack_t_s, now_s + self.random.uniform(0.001, 0.024)) + 1e-4
        return self._ack_t_s

    def put_text(self, text: Text, due_s: float) -> None:
        """STATUSTEXT, in numbered chunks when it is longer than 50 bytes."""
        raw = text.text.encode("ascii", "replace")
        chunks = [raw[i : i + _TEXT_BYTES] for i in range(0, max(len(raw), 1), _TEXT_BYTES)]
        if len(chunks) > 1:
            self._text_id = self._text_id % 65535 + 1
        number = self._text_id if len(chunks) > 1 else 0
        for sequence, chunk in enumerate(chunks):
            self.put(mavlink.MAVLink_statustext_message(text.severity, chunk, number, sequence), due_s)

    def flush(self, now_s: float, loss_frac: float) -> list[bytes]:
        """Datagrams that are due. A lost one still uses up its sequence number, as on a real link."""
        sent = []
        while self._queue and self._queue[0][0] <= now_s + 1e-9:
            datagram = heapq.heappop(self._queue)[2].pack(self._packer)
            self._packer.seq = (self._packer.seq + 1) % 256
            if loss_frac <= 0.0 or self.random.random() >= loss_frac:
                sent.append(bytes(datagram))
        return sent

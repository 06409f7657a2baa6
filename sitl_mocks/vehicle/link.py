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
from sitl_mocks.vehicle.faults import Faults
from sitl_mocks.vehicle.impostor import Impostor
from sitl_mocks.vehicle.signing import Signing, timestamp_of

_TEXT_BYTES = 50


def decode_datagram(datagram: bytes, codec: Any = None) -> Iterator[Any]:
    """The well-formed messages of one datagram; a broken one cannot swallow those of the next."""
    if codec is None:
        codec = mavlink.MAVLink(None)
        codec.robust_parsing = True
    codec.buf, codec.buf_index = bytearray(), 0
    for message in codec.parse_buffer(datagram) or ():
        if message.get_msgId() >= 0 and not message.get_type().startswith("UNKNOWN_"):
            yield message


@dataclass(slots=True)
class Outbox:
    """Messages waiting for their time; `flush` packs those that are due as one vehicle component."""

    system_id: int
    component_id: int
    random: random.Random
    signing: Signing
    faults: Faults
    _queue: list[tuple[float, int, Any]] = field(default_factory=list)
    _order: Iterator[int] = field(default_factory=itertools.count)
    _codec: Any = field(init=False)
    _impostor: Impostor = field(init=False)
    _ack_t_s: float = field(init=False, default=0.0)
    _text_id: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self._impostor = Impostor(self.system_id, self.component_id, self.random)
        self.restart()

    def restart(self) -> None:
        """As after a boot: nothing waits, sequence numbers begin again; the signing goes on."""
        self._queue.clear()
        self._codec = self.signing.codec(self.system_id, self.component_id)
        self._ack_t_s = 0.0

    def read(self, datagram: bytes, unix_s: float) -> Iterator[Any]:
        """The messages of a datagram that came in on this link and may be believed."""
        self.signing.at(unix_s)
        return decode_datagram(datagram, self._codec)

    def put(self, message: Any, due_s: float) -> None:
        """Send at due_s or at the first flush after it, in the order of the due times; bytes go as they are."""
        heapq.heappush(self._queue, (due_s, next(self._order), message))

    def answer_time_s(self, now_s: float) -> float:
        """When an answer asked for now goes out: 1 to 25 ms later, one at a time (measured on PX4)."""
        delay_s = self.random.uniform(0.001, 0.024) + self.faults.ack_delay_s
        self._ack_t_s = max(self._ack_t_s, now_s + delay_s) + 1e-4
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

    def flush(self, now_s: float, unix_s: float) -> list[bytes]:
        """Datagrams that are due. A lost one still uses up its sequence number, as on a real link."""
        sent: list[bytes] = []
        if not self._queue or self._queue[0][0] > now_s + 1e-9:
            return sent
        self.signing.at(unix_s)
        loss = self.faults.drop_downlink
        while self._queue and self._queue[0][0] <= now_s + 1e-9:
            message = heapq.heappop(self._queue)[2]
            datagram = message if isinstance(message, bytes) else self._pack(message)
            if loss <= 0.0 or self.random.random() >= loss:
                sent.append(datagram)
                sent.extend(self._attack(message, datagram, unix_s))
        return sent

    def _pack(self, message: Any) -> bytes:
        unsigned = self.faults.unsigned_frac > 0.0 and self.random.random() < self.faults.unsigned_frac
        datagram = self.signing.unsigned(message, self._codec) if unsigned else bytes(message.pack(self._codec))
        self._codec.seq = (self._codec.seq + 1) % 256
        return datagram

    def _attack(self, message: Any, datagram: bytes, unix_s: float) -> Iterator[bytes]:
        """What an impostor sends along, when the faults say so."""
        faults, impostor = self.faults, self._impostor
        if faults.replay_frac > 0.0:
            if self.random.random() < faults.replay_frac and (old := impostor.replay()) is not None:
                yield old
            impostor.hear(datagram)
        if faults.forge_frac > 0.0 and not isinstance(message, bytes) and self.random.random() < faults.forge_frac:
            signed = self.signing.key is not None and self.random.random() < 0.5
            yield impostor.forge(message, timestamp_of(unix_s + 1.0) if signed else None)

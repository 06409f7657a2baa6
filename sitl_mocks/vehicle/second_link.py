"""Another link into the mock vehicle, with its own answers: how a second ground station talks to it."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

from sitl_mocks.vehicle.dispatch import Dispatcher
from sitl_mocks.vehicle.faults import Faults
from sitl_mocks.vehicle.link import Outbox
from sitl_mocks.vehicle.streams import HEARTBEAT, Streams

if TYPE_CHECKING:
    from sitl_mocks.vehicle.core import MockVehicle


class SecondLink:
    """Call `receive` for each datagram and `step` now and then; both return what goes back on this link.

    forwarded: a router on the vehicle repeats what comes in here, and the answers to it, on the first link.
    """

    def __init__(self, vehicle: MockVehicle, *, forwarded: bool = False) -> None:
        self._vehicle = vehicle
        self._forwarded = forwarded
        first = vehicle.outbox
        self._outbox = Outbox(first.system_id, first.component_id, random.Random(2), vehicle.signing, Faults())
        self._dispatcher = Dispatcher(vehicle, self._outbox, also=first if forwarded else None)
        self._streams = Streams({HEARTBEAT: 1.0})

    def receive(self, datagram: bytes, now_s: float) -> list[bytes]:
        """Take one datagram that arrived at now_s (s); a frozen vehicle does not read it."""
        if self._vehicle.faults.frozen:
            return []
        if self._forwarded:
            self._vehicle.outbox.put(datagram, now_s)
        for message in self._outbox.read(datagram, self._vehicle.unix_s(now_s)):
            self._dispatcher.handle(message, now_s)
        self._vehicle.announce(now_s)
        return self._flush(now_s)

    def step(self, now_s: float) -> list[bytes]:
        """The vehicle's heartbeats and late answers on this link."""
        if self._vehicle.faults.frozen:
            return []
        for number in self._streams.due(now_s):
            self._outbox.put(self._vehicle.message(number, now_s), now_s)
        return self._flush(now_s)

    def _flush(self, now_s: float) -> list[bytes]:
        return self._outbox.flush(now_s, self._vehicle.unix_s(now_s))

"""A wire that keeps what is sent and hears what a test says; on a fake clock and without a socket."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import development as mav

from gcs.autopilot import Autopilot
from gcs.autopilot.px4 import Px4
from gcs.clock import FakeClock
from gcs.codec import VehicleId
from gcs.framing import Deframer, Encoder
from gcs.wire import STALE_S


class RecordingWire:
    """Stands in for a Wire: keeps what is sent, lets a test say what is received."""

    url = "udpin://127.0.0.1:14540"

    def __init__(self, clock: FakeClock, autopilot: Autopilot | None = None) -> None:
        self.clock = clock
        self.vehicle = VehicleId(1, 1, autopilot or Px4())
        self.sent: list[Any] = []
        self.subscribers: list[Any] = []

    def subscribe(self, subscriber: Any) -> Callable[[], None]:
        self.subscribers.append(subscriber)
        return lambda: self.subscribers.remove(subscriber)

    def send_message(self, message: Any, t_made_s: float | None = None) -> bool:
        stale = t_made_s is not None and self.clock.now_s() - t_made_s > STALE_S
        if not stale:
            self.sent.append(message)
        return not stale

    def hear(self, message: Any, t_s: float, system_id: int = 1, component_id: int = 1) -> None:
        (decoded,) = Deframer().datagram(Encoder(system_id, component_id).encode(message))
        for subscriber in self.subscribers:
            subscriber(decoded, t_s)


def ack(command: int, result: int, system_id: int = 255, component_id: int = 191) -> Any:
    """COMMAND_ACK, to us if nothing else is said."""
    return mav.MAVLink_command_ack_message(command, result, 0, 0, system_id, component_id)

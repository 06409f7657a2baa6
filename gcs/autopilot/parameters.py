"""Reads parameters on our own wire: all are asked for at once, so that one that does not exist costs no more.

A vehicle answers a missing name with silence, and MAVSDK asks one by one: there each costs seconds.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable, Sequence
from typing import Final

from gcs import codec
from gcs.clock import Clock
from gcs.codec import VehicleId
from gcs.framing import MARKER_V1, Message, dialect
from gcs.wire import Wire

_AGAIN_S: Final = 0.5
_ASKS: Final = 6  # a name that has not answered by then does not exist
_POLL_S: Final = 0.05
_PROGRESS_S: Final = 2.0
# MAV_PARAM_TYPE of up to four bytes, as PX4 lays them into the float byte by byte.
_INTEGERS: Final = {1: "<Bxxx", 2: "<bxxx", 3: "<Hxx", 4: "<hxx", 5: "<I", 6: "<i"}


class ParameterReader:
    """One reading of several parameters of the pinned vehicle; without waiting, so it runs on any clock.

    names: groups of names for the same parameter, of which one must answer.
    """

    def __init__(self, wire: Wire, names: Sequence[tuple[str, ...]]) -> None:
        self._wire = wire
        self._names = names
        self._asked = 0
        self._ask_t_s = 0.0
        self.values: dict[str, float] = {}
        self.close = wire.subscribe(self._received)

    @property
    def missing(self) -> list[tuple[str, ...]]:
        """The groups of which none has answered yet."""
        return [group for group in self._names if not any(name in self.values for name in group)]

    def poll(self, now_s: float) -> bool:
        """Ask for what is due; True when all have answered or nothing more can be expected."""
        missing, vehicle = self.missing, self._wire.vehicle
        if not missing or vehicle is None:
            return not missing
        if self._asked and now_s < self._ask_t_s + _AGAIN_S:
            return False
        if self._asked == _ASKS:
            return True
        self._asked, self._ask_t_s = self._asked + 1, now_s
        for name in (name for group in missing for name in group):
            self._wire.send_message(request(vehicle, name))
        return False

    def _received(self, message: Message, _t_s: float) -> None:
        vehicle = self._wire.vehicle
        if message.get_type() != "PARAM_VALUE" or vehicle is None or not codec.is_from(message, vehicle):
            return
        if any(message.param_id in group for group in self._names):
            self.values[message.param_id] = _value(message, vehicle.autopilot.integers_bytewise)


def request(vehicle: VehicleId, name: str) -> Message:
    """PARAM_REQUEST_READ of a name of at most 16 characters."""
    return dialect.MAVLink_param_request_read_message(vehicle.system_id, vehicle.component_id, name.encode("ascii"), -1)


def _value(message: Message, bytewise: bool) -> float:
    """PARAM_VALUE as a number; from the payload's bytes, because an integer may look like a NaN there."""
    if not bytewise or message.param_type not in _INTEGERS:
        return float(message.param_value)
    frame = bytes(message.get_msgbuf())
    start = 6 if frame[0] == MARKER_V1 else 10
    raw = frame[start : start + min(4, frame[1])].ljust(4, b"\0")  # MAVLink 2 leaves trailing zeros out
    return float(struct.unpack(_INTEGERS[message.param_type], raw)[0])


async def read_parameters(
    wire: Wire, clock: Clock, names: Sequence[tuple[str, ...]], say: Callable[[str], None]
) -> dict[str, float]:
    """The values of those that answered, in 3.5 s at most. Progress is said after 2 s."""
    reader, progress_s = ParameterReader(wire, names), clock.now_s() + _PROGRESS_S
    try:
        while not reader.poll(clock.now_s()):
            if clock.now_s() > progress_s:
                progress_s += _PROGRESS_S
                say("still asking the vehicle for " + ", ".join(group[0] for group in reader.missing))
            await asyncio.sleep(_POLL_S)
        return reader.values
    finally:
        reader.close()

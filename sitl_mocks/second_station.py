"""Another ground station that talks to the same vehicle through a link of its own, and does as it likes.

No socket: `step` it with the vehicle's clock. What it sends is judged by nobody; what the vehicle answers is kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.vehicle import MockVehicle, Mode, Personality
from sitl_mocks.vehicle.link import decode_datagram
from sitl_mocks.vehicle.modes import numbers
from sitl_mocks.vehicle.second_link import SecondLink
from sitl_mocks.vehicle.signing import timestamp_of

_GCS, _INVALID_AUTOPILOT = 6, 8
_VELOCITY_AND_YAW_RATE = 1479
_LOCAL_NED = 1
_SET_MODE = 176


@dataclass(slots=True)
class SecondStation:
    """forwarded: a router repeats its messages on the first station's link. heartbeats, velocity: set at any time.

    velocity_ned_mps, yaw_rate_rps: its setpoints at setpoint_hz, None = it sends none. answers: all it has heard back
    but heartbeats.
    """

    vehicle: MockVehicle
    system_id: int = 250
    component_id: int = 190
    forwarded: bool = False
    heartbeats: bool = True
    velocity_ned_mps: tuple[float, float, float] | None = None
    yaw_rate_rps: float = 0.0
    setpoint_hz: float = 20.0
    signing_key: bytes | None = None
    answers: list[Any] = field(default_factory=list)
    sent: int = 0
    _link: SecondLink = field(init=False)
    _codec: Any = field(init=False)
    _heartbeat_due_s: float = -math.inf
    _setpoint_due_s: float = -math.inf

    def __post_init__(self) -> None:
        self._link = self.vehicle.second_link(forwarded=self.forwarded)
        self._codec = mavlink.MAVLink(None, self.system_id, self.component_id)
        self._codec.signing.secret_key = self.signing_key
        self._codec.signing.sign_outgoing = self.signing_key is not None

    def step(self, now_s: float) -> None:
        """Send what is due at now_s (s) and read the answers."""
        if self.heartbeats and now_s >= self._heartbeat_due_s:
            self._heartbeat_due_s = now_s + 1.0
            self.send(mavlink.MAVLink_heartbeat_message(_GCS, _INVALID_AUTOPILOT, 0, 0, 4, 3), now_s)
        if self.velocity_ned_mps is not None and now_s >= self._setpoint_due_s:
            self._setpoint_due_s = now_s + 1.0 / self.setpoint_hz
            self.send(self._setpoint(*self.velocity_ned_mps), now_s)
        self._read(self._link.step(now_s))

    def set_mode(self, mode: Mode, now_s: float) -> None:
        """Ask for a flight mode as QGroundControl and Mission Planner do."""
        number = numbers(self.vehicle.personality)[mode]
        px4 = self.vehicle.personality is Personality.PX4
        main, sub = (number >> 16 & 0xFF, number >> 24) if px4 else (number, 0)
        self.command(_SET_MODE, (1.0, float(main), float(sub)), now_s)

    def command(self, number: int, params: tuple[float, ...], now_s: float) -> None:
        """Send a COMMAND_LONG; missing params are zero."""
        values = (*params, *(0.0,) * (7 - len(params)))
        target = self.vehicle.outbox.system_id, self.vehicle.outbox.component_id
        self.send(mavlink.MAVLink_command_long_message(*target, number, 0, *values), now_s)

    def send(self, message: Any, now_s: float) -> None:
        """Send any message under this station's address."""
        self._codec.seq = (self._codec.seq + 1) % 256
        self._codec.signing.timestamp = max(self._codec.signing.timestamp, timestamp_of(self.vehicle.unix_s(now_s)))
        self.sent += 1
        self._read(self._link.receive(bytes(message.pack(self._codec)), now_s))

    def _setpoint(self, north: float, east: float, down: float) -> Any:
        target = self.vehicle.outbox.system_id, self.vehicle.outbox.component_id
        return mavlink.MAVLink_set_position_target_local_ned_message(
            0, *target, _LOCAL_NED, _VELOCITY_AND_YAW_RATE, 0, 0, 0, north, east, down, 0, 0, 0, 0, self.yaw_rate_rps
        )

    def _read(self, datagrams: list[bytes]) -> None:
        for datagram in datagrams:
            self.answers.extend(m for m in decode_datagram(datagram) if m.get_type() != "HEARTBEAT")

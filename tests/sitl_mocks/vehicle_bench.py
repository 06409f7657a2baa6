"""A ground station on a fake clock, for the tests of the mock vehicle: pymavlink and nothing else."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.monitor import WireMonitor
from sitl_mocks.vehicle import MockVehicle
from sitl_mocks.vehicle.link import decode_datagram

NAN = math.nan
STEP_S = 0.005
SET_MODE, ARM, TAKEOFF, LAND = 176, 400, 22, 21
PX4_OFFBOARD = (129.0, 6.0, 0.0)
PX4_HOLD = (129.0, 4.0, 3.0)


class Bench:
    """Station and vehicle together; `inbox` keeps every message of the vehicle as (time, message)."""

    def __init__(self, vehicle: MockVehicle, start_s: float = 100.0, monitor: WireMonitor | None = None) -> None:
        self.vehicle = vehicle
        self.monitor = monitor
        self.now_s = start_s
        self.inbox: list[tuple[float, Any]] = []
        self.velocity: tuple[float, float, float, float] | None = None
        self.frame = 1
        self.setpoint_hz = 20.0
        self.heartbeats = False
        self._setpoint_due_s = self._heartbeat_due_s = start_s
        self._packer = mavlink.MAVLink(None, 245, 190)
        self._take(vehicle.step(start_s))

    def send(self, message: Any) -> None:
        datagram = bytes(message.pack(self._packer))
        self._packer.seq = (self._packer.seq + 1) % 256
        if self.monitor is not None:
            self.monitor.feed(self.now_s, datagram, self.vehicle.truth())
        self._take(self.vehicle.receive(datagram, self.now_s))

    def run(self, duration_s: float) -> None:
        for _ in range(round(duration_s / STEP_S)):
            self.now_s += STEP_S
            if self.velocity is not None and self.now_s >= self._setpoint_due_s - 1e-9:
                self._setpoint_due_s = max(self._setpoint_due_s, self.now_s) + 1.0 / self.setpoint_hz
                self.setpoint(*self.velocity)
            if self.heartbeats and self.now_s >= self._heartbeat_due_s - 1e-9:
                self._heartbeat_due_s = max(self._heartbeat_due_s, self.now_s) + 1.0
                self.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
            self._take(self.vehicle.step(self.now_s))
            if self.monitor is not None:
                self.monitor.tick(self.now_s, self.vehicle.truth())

    def setpoint(self, vx: float, vy: float, vz: float, yaw_rate: float, mask: int = 1479, **other: Any) -> None:
        frame = other.get("frame", self.frame)
        self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, other.get("system", 1), 1, frame, mask, 0, 0, 0, vx, vy, vz, 0, 0, 0, NAN, yaw_rate
            )
        )

    def command(self, number: int, *params: float, system: int = 1, component: int = 1) -> int | None:
        """Send a command and wait 50 ms of fake time for its COMMAND_ACK; None = there was none."""
        values = [*params, *[NAN] * (7 - len(params))]
        since = len(self.inbox)
        self.send(mavlink.MAVLink_command_long_message(system, component, number, 0, *values))
        self.run(0.05)
        for _, message in self.inbox[since:]:
            if message.get_type() == "COMMAND_ACK" and message.command == number:
                return int(message.result)
        return None

    def of(self, kind: str, since_s: float = -math.inf) -> list[tuple[float, Any]]:
        return [(t, m) for t, m in self.inbox if m.get_type() == kind and t >= since_s]

    def newest(self, kind: str) -> Any:
        return self.of(kind)[-1][1]

    def texts(self, since_s: float = -math.inf) -> list[str]:
        """Whole texts, their chunks joined."""
        joined: list[str] = []
        for _, m in self.of("STATUSTEXT", since_s):
            if m.id and m.chunk_seq:
                joined[-1] += m.text
            else:
                joined.append(m.text)
        return joined

    def count(self, since_s: float) -> Counter[str]:
        return Counter(m.get_type() for t, m in self.inbox if t >= since_s)

    def engage(self, speed_mps: float = 3.0) -> None:
        """PX4: stream a northward velocity and enter OFFBOARD."""
        self.velocity = (speed_mps, 0.0, 0.0, 0.0)
        self.run(0.2)
        assert self.command(SET_MODE, *PX4_OFFBOARD) == 0

    def fall_silent(self) -> float:
        """Stop the stream; returns the time of the last setpoint."""
        self.velocity = None
        last = self.vehicle.autopilot.setpoint_t_s
        assert last is not None
        return last

    def _take(self, datagrams: list[bytes]) -> None:
        for datagram in datagrams:
            self.inbox.extend((self.now_s, message) for message in decode_datagram(datagram))

"""The other end of a wire in tests: a bare UDP socket that speaks through pymavlink."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import development as mav

from control.gate import Limits, Setpoint, gate
from control.types import Vec3, VehicleMode, VehicleState, VelocityRequest

PX4, ARDUPILOT = 12, 3
PX4_OFFBOARD, PX4_LOITER, PX4_POSCTL = 6 << 16, 4 << 16 | 3 << 24, 3 << 16


def heartbeat(autopilot: int = PX4, custom_mode: int = PX4_OFFBOARD, base_mode: int = 0x91, status: int = 4) -> Any:
    """A quadrotor's heartbeat."""
    return mav.MAVLink_heartbeat_message(2, autopilot, base_mode, custom_mode, status, 3)


class Peer:
    """A vehicle's address: sends messages, collects what comes back."""

    def __init__(self, port: int, system_id: int = 1, component_id: int = 1) -> None:
        self.mav = mav.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self._parser = mav.MAVLink(None)
        self.sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.sock.bind(("127.0.0.1", 0))
        self.sock.setblocking(False)
        self._to = ("127.0.0.1", port)

    def frame(self, message: Any) -> bytes:
        data: bytes = message.pack(self.mav)
        self.mav.seq = (self.mav.seq + 1) % 256
        return data

    def send(self, message: Any) -> None:
        self.send_bytes(self.frame(message))

    def send_bytes(self, data: bytes) -> None:
        self.sock.sendto(data, self._to)

    def received(self) -> list[Any]:
        """Every message that has come since the last call."""
        messages = []
        while True:
            try:
                data = self.sock.recv(65536)
            except BlockingIOError:
                return messages
            messages.extend(self._parser.parse_buffer(data) or [])

    def close(self) -> None:
        self.sock.close()


async def eventually(condition: Callable[[], Any], timeout_s: float = 5.0) -> Any:
    """Let the event loop run until the condition is true; fails the test otherwise."""
    loop = asyncio.get_running_loop()
    end_s = loop.time() + timeout_s
    while not (value := condition()):
        assert loop.time() < end_s, "did not happen"
        await asyncio.sleep(0.005)
    return value


def setpoint(now_s: float, velocity_ned_mps: Vec3 = (0.15, -0.1, 0.05), yaw_rate_rps: float = 0.1) -> Setpoint:
    """A real setpoint: through the gate, as nothing else can make one. Small enough to pass its slew limits."""
    vehicle = VehicleState(
        heartbeat_t_s=now_s,
        mode=VehicleMode.EXTERNAL,
        mode_t_s=now_s,
        armed=True,
        in_air=True,
        attitude_t_s=now_s,
        position_t_s=now_s,
        position_ned_m=(0.0, 0.0, -10.0),
        height_m=10.0,
    )
    value, reason = gate(VelocityRequest(now_s, velocity_ned_mps, yaw_rate_rps), vehicle, now_s, None, Limits())
    assert value is not None, reason
    return value


def free_port(kind: int = socket.SOCK_DGRAM) -> int:
    """A port of loopback that nobody has."""
    with socket.socket(socket.AF_INET, kind) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


async def got(peer: Peer, name: str) -> list[Any]:
    """Wait for messages of this name to arrive at the peer."""
    seen: list[Any] = []
    return await eventually(lambda: seen.extend(peer.received()) or [m for m in seen if m.get_type() == name])


class Loopback:
    """A transport without a socket or an event loop."""

    status, connections = "open", 1

    def __init__(self, received: Callable[[bytes, tuple[str, int] | None], None]) -> None:
        self.received = received
        self.sent: list[bytes] = []

    def send(self, data: bytes) -> bool:
        self.sent.append(data)
        return True

    def reply_to(self, peer: tuple[str, int]) -> None:
        self.peer = peer

    async def close(self) -> None:
        """Nothing to close."""

"""The mock vehicle on a real UDP socket, in real time."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from typing import cast

from sitl_mocks.vehicle.core import MockVehicle

Observer = Callable[[bytes, float], None]
_STEP_S = 0.005
_PARTNER_SILENCE_S = 3.0


class _Socket(asyncio.DatagramProtocol):
    """Hands what arrives to the vehicle and sends its answers to the remote end."""

    def __init__(self, vehicle: MockVehicle, remote: tuple[str, int], observe: Observer | None) -> None:
        self._vehicle = vehicle
        self._remote = remote
        self._observe = observe
        self._heard_s = -math.inf
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        # asyncio's own UDP transport does not derive from DatagramTransport on Python 3.11.
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        now_s = time.monotonic()
        self._learn(addr[:2], now_s)
        if self._observe is not None:
            self._observe(data, now_s)
        self.send(self._vehicle.receive(data, now_s))

    def _learn(self, sender: tuple[str, int], now_s: float) -> None:
        """Telemetry follows the first station that writes, another one only after that has been silent."""
        if sender != self._remote and now_s - self._heard_s < _PARTNER_SILENCE_S:
            return
        self._remote, self._heard_s = sender, now_s

    def error_received(self, exc: Exception) -> None:
        """Nobody listens yet: a vehicle keeps sending all the same."""

    def send(self, datagrams: list[bytes]) -> None:
        if self._transport is None or self._transport.is_closing():
            return
        for datagram in datagrams:
            self._transport.sendto(datagram, self._remote)


async def run_udp(
    vehicle: MockVehicle,
    remote: tuple[str, int] = ("127.0.0.1", 14540),
    *,
    local: tuple[str, int] = ("127.0.0.1", 0),
    observe: Observer | None = None,
    on_step: Callable[[float], None] | None = None,
    step_s: float = _STEP_S,
) -> None:
    """Fly until cancelled: sends to `remote` from `local` (port 0 = any) and then to the station that
    answers, if that is another port.

    observe(datagram, now_s) sees every datagram before the vehicle does, on_step(now_s) each step: there a
    WireMonitor is fed. Times are time.monotonic().
    """
    loop = asyncio.get_running_loop()
    if vehicle.unix_start_s is None:
        vehicle.unix_start_s = time.time()
    transport, protocol = await loop.create_datagram_endpoint(
        lambda: _Socket(vehicle, remote, observe), local_addr=local
    )
    try:
        due_s = time.monotonic()
        while True:
            now_s = time.monotonic()
            protocol.send(vehicle.step(now_s))
            if on_step is not None:
                on_step(now_s)
            due_s = max(due_s + step_s, now_s)
            await asyncio.sleep(max(due_s - time.monotonic(), 0.001))
    finally:
        transport.close()

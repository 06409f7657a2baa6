"""The mock vehicle's socket: whom it sends to, and what the observer sees."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress

from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.vehicle import MockVehicle
from sitl_mocks.vehicle.server import run_udp
from sitl_mocks.vehicle.signing import timestamp_of


class Station(asyncio.DatagramProtocol):
    """A socket that remembers what came in and can wait for the next datagram."""

    def __init__(self) -> None:
        self.heard: asyncio.Queue[tuple[bytes, tuple[str, int]]] = asyncio.Queue()

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        self.heard.put_nowait((data, addr))


async def open_station() -> tuple[asyncio.DatagramTransport, Station, int]:
    loop = asyncio.get_running_loop()
    transport, station = await loop.create_datagram_endpoint(Station, local_addr=("127.0.0.1", 0))
    return transport, station, transport.get_extra_info("sockname")[1]


async def hears_something(station: Station) -> bool:
    while not station.heard.empty():
        station.heard.get_nowait()
    with suppress(TimeoutError):
        await asyncio.wait_for(station.heard.get(), 0.3)
        return True
    return False


async def test_telemetry_goes_to_the_station_that_answers_and_stays_there() -> None:
    first_wire, first, first_port = await open_station()
    second_wire, second, _ = await open_station()
    third_wire, third, _ = await open_station()
    observed: list[bytes] = []
    steps: list[float] = []
    vehicle = run_udp(
        MockVehicle(),
        ("127.0.0.1", first_port),
        observe=lambda datagram, _now_s: observed.append(datagram),
        on_step=steps.append,
    )
    task = asyncio.create_task(vehicle)
    try:
        _, vehicle_address = await asyncio.wait_for(first.heard.get(), 2.0)
        heartbeat = bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(mavlink.MAVLink(None, 245, 190)))
        second_wire.sendto(heartbeat, vehicle_address)
        await asyncio.wait_for(second.heard.get(), 2.0)
        third_wire.sendto(heartbeat, vehicle_address)
        assert await hears_something(second)
        assert not await hears_something(first)
        assert not await hears_something(third)
        assert observed == [heartbeat, heartbeat]
        assert len(steps) > 10
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        for wire in (first_wire, second_wire, third_wire):
            wire.close()


async def test_in_real_time_signatures_carry_the_real_time() -> None:
    key = bytes(range(32))
    wire, station, port = await open_station()
    task = asyncio.create_task(run_udp(MockVehicle(signing_key=key), ("127.0.0.1", port)))
    try:
        data, _ = await asyncio.wait_for(station.heard.get(), 2.0)
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        wire.close()
    stamped = int.from_bytes(data[-12:-6], "little")
    assert abs(stamped - timestamp_of(time.time())) < 5 * 100_000

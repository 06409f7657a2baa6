"""Who is on the other end of a wire: one vehicle, pinned; everybody else is ignored and named."""

from __future__ import annotations

import socket

import pytest
from pymavlink.dialects.v20 import development as mav

from gcs.clock import FakeClock
from gcs.errors import VehicleError, WireError
from gcs.wire import PEER_SILENCE_S, Wire
from tests.gcs.wire_peer import Peer, eventually, free_port, got, heartbeat


async def test_another_address_is_ignored_until_the_vehicles_is_silent():
    clock, port = FakeClock(10.0), free_port()
    wire = await Wire.open(f"udpin://127.0.0.1:{port}", clock=clock)
    vehicle, other = Peer(port), Peer(port)
    try:
        vehicle.send(heartbeat())
        await wire.wait_vehicle(5.0)
        other.send(heartbeat())
        await eventually(lambda: wire.counters.foreign_datagrams == 1)
        wire.send_heartbeat()
        assert await got(vehicle, "HEARTBEAT")
        assert other.received() == []
        clock.advance(PEER_SILENCE_S + 0.1)  # the vehicle comes back from another port
        good = wire.frames.good
        other.send(heartbeat())
        await eventually(lambda: wire.frames.good > good)
        wire.send_heartbeat()
        assert await got(other, "HEARTBEAT")
        assert vehicle.received() == []
    finally:
        await wire.close()
        vehicle.close()
        other.close()


async def test_a_second_vehicle_on_the_same_address_does_not_replace_the_first(link):
    wire, peer = link
    second = mav.MAVLink(None, srcSystem=2, srcComponent=1)
    peer.send_bytes(heartbeat(autopilot=3).pack(second))
    good = wire.frames.good
    await eventually(lambda: wire.frames.good > good)
    assert wire.vehicle.system_id == 1


async def test_wanted_system_id_is_waited_for():
    port = free_port()
    wire, first, second = await Wire.open(f"udpin://127.0.0.1:{port}", vehicle_system_id=2), Peer(port), Peer(port, 2)
    try:
        first.send(heartbeat())
        with pytest.raises(VehicleError, match=r"heard PX4 \(system 1\), wanted system 2"):
            await wire.wait_vehicle(0.2)
        second.send(heartbeat())
        assert (await wire.wait_vehicle(5.0)).system_id == 2
    finally:
        await wire.close()
        first.close()
        second.close()


async def test_port_in_use_is_one_clear_error(link):
    wire, _ = link
    with pytest.raises(WireError, match=f"{wire.url}.*in use.*another ground station"):
        await Wire.open(wire.url)


async def test_port_held_with_address_reuse_is_refused_too():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        holder.bind(("127.0.0.1", 0))
        with pytest.raises(WireError, match="in use"):
            await Wire.open(f"udpin://127.0.0.1:{holder.getsockname()[1]}")


@pytest.mark.parametrize(
    ("say", "reason"),
    [
        (None, "nobody has sent anything"),
        (b"hello there", "not MAVLink"),
        (mav.MAVLink_attitude_message(1, 0, 0, 0, 0, 0, 0), "no autopilot's heartbeat"),
        (mav.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3), "neither a PX4 nor an ArduPilot multicopter"),
    ],
)
async def test_no_vehicle_is_one_clear_error(say, reason):
    port = free_port()
    wire, peer = await Wire.open(f"udpin://127.0.0.1:{port}"), Peer(port)
    try:
        if say is not None:
            peer.send_bytes(say if isinstance(say, bytes) else peer.frame(say))
        with pytest.raises(VehicleError, match=rf"no vehicle at udpin://127.0.0.1:{port} within 0.2 s: .*{reason}"):
            await wire.wait_vehicle(0.2)
    finally:
        await wire.close()
        peer.close()

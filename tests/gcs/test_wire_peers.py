"""Who is on the other end of a wire: one vehicle, pinned; everybody else is ignored and named."""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
import time

import pytest
from pymavlink.dialects.v20 import development as mav

from gcs.clock import FakeClock
from gcs.errors import VehicleError, WireError
from gcs.framing import Deframer
from gcs.pinning import VehiclePin
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


@pytest.mark.parametrize("option", [None, socket.SO_REUSEADDR, socket.SO_REUSEPORT])
async def test_a_port_held_by_another_program_says_how_to_find_it(option):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        if option is not None:
            holder.setsockopt(socket.SOL_SOCKET, option, 1)
        holder.bind(("127.0.0.1", 0))
        port = holder.getsockname()[1]
        with pytest.raises(WireError, match=rf"UDP port {port} is in use.*shows by whom$") as caught:
            await Wire.open(f"udpin://127.0.0.1:{port}")
        if (command := re.search(r"`(ss .*)`", str(caught.value))) and shutil.which("ss"):
            found = subprocess.run(command[1].split(), capture_output=True, text=True, check=True)
            assert f"pid={os.getpid()}" in found.stdout  # what the line tells people to run does tell them


@pytest.mark.parametrize("option", [None, socket.SO_REUSEADDR, socket.SO_REUSEPORT])
async def test_our_port_cannot_be_shared(link, option):
    wire, _ = link
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as second:
        if option is not None:
            second.setsockopt(socket.SOL_SOCKET, option, 1)
        with pytest.raises(OSError, match="in use"):
            second.bind(("127.0.0.1", int(wire.url.rpartition(":")[2])))


async def test_a_port_that_is_not_ours_to_open_is_not_called_taken():
    with pytest.raises(WireError, match=r"udpin://192\.0\.2\.1:14540: Cannot assign requested address$"):
        await Wire.open("udpin://192.0.2.1:14540")


async def test_a_second_vehicle_at_another_address_is_ignored_and_named(link):
    wire, _ = link
    second, ignored = Peer(int(wire.url.rpartition(":")[2]), system_id=7), wire.counters.foreign_datagrams
    try:
        seen = []
        wire.subscribe(lambda message, t_s: seen.append(message.get_srcSystem()))
        second.send(heartbeat(autopilot=3))
        await eventually(lambda: wire.counters.foreign_datagrams > ignored)
        address = "{}:{}".format(*second.sock.getsockname())
        assert wire.other_vehicles(time.monotonic()) == (f"ArduCopter (system 7) at {address}",)
        assert wire.other_vehicles(time.monotonic() + 6.0) == ()
        assert seen == []
    finally:
        second.close()


async def test_a_second_vehicle_behind_the_same_router_is_named(link):
    wire, peer = link
    second = mav.MAVLink(None, srcSystem=2, srcComponent=1)
    peer.send_bytes(heartbeat(autopilot=3).pack(second))
    await eventually(lambda: wire.other_vehicles(time.monotonic()) == ("ArduCopter (system 2)",))
    assert wire.vehicle.system_id == 1


async def test_another_autopilot_under_the_vehicles_ids_is_not_believed(link):
    wire, peer = link
    seen = []
    wire.subscribe(lambda message, t_s: seen.append(message.autopilot))
    peer.send(heartbeat(autopilot=3, custom_mode=4))  # would read as another mode
    peer.send(mav.MAVLink_heartbeat_message(1, 12, 0x91, 0, 4, 3))  # nor an aeroplane
    peer.send(heartbeat())
    await eventually(lambda: seen)
    assert seen == [12]
    assert wire.other_vehicles(time.monotonic()) == ("ArduCopter (system 1)",)


def test_the_names_of_others_are_bounded():
    pin = VehiclePin(None)
    deframer, packers = Deframer(), [mav.MAVLink(None, srcSystem=n, srcComponent=1) for n in range(1, 100)]
    for n, packer in enumerate(packers):
        pin.is_ours(deframer.datagram(heartbeat().pack(packer))[0], n * 0.01)
    assert pin.vehicle.system_id == 1
    assert len(pin.others(1.0)) == 16
    assert pin.others(200.0) == ()
    pin.is_ours(deframer.datagram(heartbeat().pack(packers[50]))[0], 200.0)
    assert pin.others(200.0) == ("PX4 (system 51)",)  # those long gone make room

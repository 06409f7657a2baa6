"""The byte transports: addresses, and how each of them comes up, sends without a queue and comes back."""

from __future__ import annotations

import asyncio
import os
import socket
import time

import pytest
from pymavlink.dialects.v20 import development as mav

from gcs import transport_stream
from gcs.errors import VehicleError, WireError
from gcs.framing import Encoder
from gcs.transport import parse_url
from gcs.wire import Wire
from tests.gcs.wire_peer import Peer, eventually, free_port, heartbeat, setpoint


@pytest.mark.parametrize(
    ("url", "what"),
    [
        ("udp://127.0.0.1:14540", "expected udpin"),
        ("14540", "expected udpin"),
        ("udpin://127.0.0.1", "host and a port"),
        ("udpin://:14540", "host and a port"),
        ("udpin://127.0.0.1:99999", "[Pp]ort"),
        ("udpin://127.0.0.1:x", "[Pp]ort"),
        ("udpout://127.0.0.1:0", "host and a port"),
        ("tcpout://127.0.0.1:5760/x", "nothing may follow"),
        ("serial:///dev/ttyACM0", "baud"),
        ("serial://:57600", "device"),
        ("serial:///dev/ttyACM0:fast", "baud"),
    ],
)
def test_bad_url_is_one_clear_error(url, what):
    with pytest.raises(WireError, match=what):
        parse_url(url)


@pytest.mark.parametrize(
    "url", ["udpin://0.0.0.0:14540", "udpout://10.0.0.2:14550", "tcpout://host:5760", "serial:///dev/ttyACM0:57600"]
)
def test_good_url_keeps_its_form(url):
    assert str(parse_url(url)) == url


async def test_udpout_speaks_first():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        vehicle.setblocking(False)
        wire = await Wire.open(f"udpout://127.0.0.1:{vehicle.getsockname()[1]}")
        try:
            assert wire.send_heartbeat()
            loop = asyncio.get_running_loop()
            data, address = await asyncio.wait_for(loop.sock_recvfrom(vehicle, 1000), 5.0)
            assert data[5:7] == bytes([255, 191])
            await loop.sock_sendto(vehicle, Encoder(1, 1).encode(heartbeat()), address)
            assert (await wire.wait_vehicle(5.0)).system_id == 1
        finally:
            await wire.close()


async def test_failed_send_says_so_and_is_forgotten_when_something_is_heard():
    port = free_port()
    wire, peer = await Wire.open(f"udpin://127.0.0.1:{port}"), Peer(port)
    try:
        wire._transport.error_received(OSError(101, "Network is unreachable"))
        with pytest.raises(VehicleError, match=r"Network is unreachable$"):
            await wire.wait_vehicle(0.05)
        peer.send(heartbeat())
        await wire.wait_vehicle(5.0)
        assert wire._transport.status == "bytes have been heard"
    finally:
        await wire.close()
        peer.close()


async def test_unknown_host_is_one_clear_error():
    with pytest.raises(WireError, match="unknown host"):
        await Wire.open("udpout://no-such-host.invalid:14550")


async def test_tcpout_waits_for_its_peer_and_comes_back(monkeypatch):
    monkeypatch.setattr(transport_stream, "backoff_s", lambda: iter([0.01] * 1000))
    port = free_port(socket.SOCK_STREAM)
    wire = await Wire.open(f"tcpout://127.0.0.1:{port}")
    with pytest.raises(VehicleError, match="cannot connect"):
        await wire.wait_vehicle(0.2)
    clients = []
    server = await asyncio.start_server(lambda r, w: clients.append((r, w)), "127.0.0.1", port)
    try:
        for n in range(2):
            reader, writer = (await eventually(lambda n=n: clients[n:]))[0]
            writer.write(b"\xfd\xff" * (n == 0) + Encoder(1, 1).encode(heartbeat())[: 10 if n == 0 else None])
            if n == 1:
                await wire.wait_vehicle(5.0)  # the torn frame of the first connection is forgotten
                assert wire.frames.good == 1
                assert wire.send_heartbeat()
                assert (await asyncio.wait_for(reader.readexactly(10), 5.0))[5:7] == bytes([255, 191])
            writer.close()
    finally:
        await wire.close()
        server.close()


async def test_tcpout_does_not_queue_for_a_peer_that_takes_nothing():
    taken = asyncio.Event()
    server = await asyncio.start_server(lambda r, w: taken.set(), "127.0.0.1", 0, limit=1)
    wire = await Wire.open(f"tcpout://127.0.0.1:{server.sockets[0].getsockname()[1]}")
    try:
        await asyncio.wait_for(taken.wait(), 5.0)
        await eventually(wire.send_heartbeat)
        for n in range(200_000):
            if not wire.send_heartbeat():
                break
            if n % 100 == 0:
                await asyncio.sleep(0)
        assert wire.counters.unsent > 0
        assert wire._transport._writer.transport.get_write_buffer_size() <= 21
    finally:
        await wire.close()
        server.close()


async def test_tcpout_gives_up_a_peer_that_takes_nothing_and_its_old_frames_with_it():
    """Else the system would go on offering them, and hand them over when the peer wakes up."""
    with socket.socket() as vehicle:
        vehicle.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
        vehicle.bind(("127.0.0.1", 0))
        vehicle.listen(1)
        vehicle.setblocking(False)
        wire = await Wire.open(f"tcpout://127.0.0.1:{vehicle.getsockname()[1]}")

        def given_up():
            sent = [wire.send_heartbeat() for _ in range(50)]
            return not any(sent) and wire._transport.status.endswith("the peer takes nothing")

        try:
            frozen, _ = await asyncio.get_running_loop().sock_accept(vehicle)
            await eventually(wire.send_heartbeat)
            await eventually(given_up, 20.0)
            frozen.close()
        finally:
            await wire.close()


async def test_tcpin_serves_one_client_and_turns_a_second_away():
    port = free_port(socket.SOCK_STREAM)
    wire = await Wire.open(f"tcpin://127.0.0.1:{port}")
    try:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(Encoder(1, 1).encode(heartbeat()))
        await wire.wait_vehicle(5.0)
        second, second_writer = await asyncio.open_connection("127.0.0.1", port)
        assert await asyncio.wait_for(second.read(), 5.0) == b""
        assert wire.send_heartbeat()
        assert (await asyncio.wait_for(reader.readexactly(10), 5.0))[0] == 0xFD
        with pytest.raises(WireError, match="in use"):
            await Wire.open(f"tcpin://127.0.0.1:{port}")
        writer.close()
        second_writer.close()
    finally:
        await wire.close()


@pytest.fixture
def terminal():
    """A pseudo terminal: (our side's descriptor, the device's name)."""
    pytest.importorskip("serial", reason="needs the serial extra")
    master, slave = os.openpty()
    os.set_blocking(master, False)
    yield master, os.ttyname(slave)
    os.close(slave)
    os.close(master)


def read_frame(master):
    try:
        return os.read(master, 4096)
    except BlockingIOError:
        return b""


async def test_serial_carries_frames_in_pieces(terminal):
    master, device = terminal
    wire = await Wire.open(f"serial://{device}:57600")
    try:
        frame = Encoder(1, 1).encode(heartbeat())
        os.write(master, b"boot: ok\r\n" + frame[:7])
        await asyncio.sleep(0)
        os.write(master, frame[7:])
        await wire.wait_vehicle(5.0)
        assert wire.send_setpoint(setpoint(time.monotonic()))
        data = await eventually(lambda: read_frame(master))
        assert data[0] == 0xFD
        assert data[7] == mav.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
    finally:
        await wire.close()


async def test_serial_device_in_use_or_missing_is_one_clear_error(terminal):
    _, device = terminal
    wire = await Wire.open(f"serial://{device}:57600")
    try:
        with pytest.raises(WireError, match=device):
            await Wire.open(f"serial://{device}:57600")
    finally:
        await wire.close()
    with pytest.raises(WireError, match="No such file"):
        await Wire.open("serial:///dev/no_such_device:57600")


async def test_serial_without_pyserial_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "serial", None)
    with pytest.raises(WireError, match="pip install"):
        await Wire.open("serial:///dev/ttyACM0:57600")


async def test_serial_comes_back_after_it_was_pulled(tmp_path, monkeypatch):
    pytest.importorskip("serial", reason="needs the serial extra")
    monkeypatch.setattr(transport_stream, "backoff_s", lambda: iter([0.01] * 1000))
    name = tmp_path / "ttyTEST"
    master, slave = os.openpty()
    name.symlink_to(os.ttyname(slave))
    wire = await Wire.open(f"serial://{name}:57600")
    try:
        os.close(master)
        os.close(slave)
        await eventually(lambda: wire._transport.status.startswith("lost"))
        assert not wire.send_heartbeat()
        master, slave = os.openpty()
        name.unlink()
        name.symlink_to(os.ttyname(slave))
        await eventually(lambda: wire._transport.status == "open")
        os.write(master, Encoder(1, 1).encode(heartbeat()))
        await wire.wait_vehicle(5.0)
    finally:
        await wire.close()
        os.close(master)
        os.close(slave)

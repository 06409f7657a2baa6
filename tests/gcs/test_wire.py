"""The wire over real sockets: what leaves, what is dropped, what is refused."""

from __future__ import annotations

import asyncio
import os
import socket
import time
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import development as mav

from gcs import codec, transport_stream
from gcs.clock import FakeClock, MonotonicClock
from gcs.errors import VehicleError, WireError
from gcs.framing import Encoder
from gcs.link_meters import LossMeter
from gcs.tlog import TlogWriter
from gcs.transport import parse_url
from gcs.wire import PEER_SILENCE_S, STALE_S, Wire
from tests.gcs.wire_peer import Peer, eventually, heartbeat, setpoint


def free_port(kind=socket.SOCK_DGRAM):
    with socket.socket(socket.AF_INET, kind) as sock:
        sock.bind(("127.0.0.1", 0))
        return sock.getsockname()[1]


@pytest.fixture
async def link():
    """A wire with a vehicle already pinned, and the vehicle's end."""
    port = free_port()
    wire = await Wire.open(f"udpin://127.0.0.1:{port}")
    peer = Peer(port)
    peer.send(heartbeat())
    await wire.wait_vehicle(5.0)
    yield wire, peer
    await wire.close()
    peer.close()


async def got(peer, name):
    seen = []
    return await eventually(lambda: seen.extend(peer.received()) or [m for m in seen if m.get_type() == name])


async def test_setpoint_leaves_once(link):
    wire, peer = link
    assert wire.send_setpoint(setpoint(time.monotonic()))
    (message,) = await got(peer, "SET_POSITION_TARGET_LOCAL_NED")
    assert (message.get_srcSystem(), message.get_srcComponent()) == (255, 191)
    assert message.type_mask == 0x5C7
    await asyncio.sleep(0.15)  # a library that re-sent it would have by now
    assert peer.received() == []
    assert wire.counters.setpoints_sent == 1


async def test_only_the_gates_setpoint_moves_the_vehicle(link):
    wire, peer = link
    moving = codec.setpoint(setpoint(0.0), wire.vehicle, 0)
    with pytest.raises(TypeError, match=r"control\.gate"):
        wire.send_setpoint(moving)
    with pytest.raises(ValueError, match="only send_setpoint"):
        wire.send_message(moving)
    assert not wire.send_raw(Encoder(245, 190).encode(moving), time.monotonic())
    sticks = mav.MAVLink_manual_control_message(1, 0, 0, 0, 0, 0)
    hidden = Encoder(245, 190)
    assert not wire.send_raw(hidden.encode(codec.heartbeat()) + hidden.encode(sticks), time.monotonic())
    assert not wire.send_raw(b"not mavlink", time.monotonic())
    assert wire.counters.refused == 3
    wire.send_heartbeat()
    await got(peer, "HEARTBEAT")
    assert wire.counters.sent == 1


async def test_after_a_blocked_loop_old_frames_are_dropped(link):
    wire, peer = link
    loop, clock = asyncio.get_running_loop(), MonotonicClock()
    old_frame, old = Encoder(245, 190).encode(codec.heartbeat()), setpoint(clock.now_s())
    loop.call_soon(wire.send_raw, old_frame, clock.now_s())
    loop.call_soon(wire.send_setpoint, old)
    time.sleep(0.3)  # the loop is blocked, as by a stalled computation
    assert peer.received() == []
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert wire.counters.stale == 2
    wire.send_setpoint(setpoint(clock.now_s()))
    (message,) = await got(peer, "SET_POSITION_TARGET_LOCAL_NED")
    assert message.get_seq() == 0  # the stale one has not spent a number
    assert wire.counters.sent == 1


async def test_staleness_bound_is_exact():
    clock, port = FakeClock(100.0), free_port()
    wire, peer = await Wire.open(f"udpin://127.0.0.1:{port}", clock=clock), Peer(port)
    try:
        peer.send(heartbeat())
        await wire.wait_vehicle(5.0)
        value = setpoint(100.0)
        clock.advance(STALE_S - 1e-6)
        assert wire.send_setpoint(value)
        clock.advance(2e-6)
        assert not wire.send_setpoint(value)
        assert not wire.send_raw(Encoder(1, 1).encode(codec.heartbeat()), float("nan"))
        assert wire.counters.stale == 2
    finally:
        await wire.close()
        peer.close()


async def test_the_whole_backlog_is_read_before_anything_acts_on_it(link):
    wire, peer = link
    seen = []
    wire.subscribe(lambda message, t_s: seen.append(message.custom_mode))
    for number in range(100):
        peer.send(heartbeat(custom_mode=number))
    time.sleep(0.05)
    acted_on = []
    asyncio.get_running_loop().call_later(0, lambda: acted_on.append(seen[-1]))
    await eventually(lambda: acted_on)
    assert acted_on == [99]


async def test_subscriber_gets_arrival_times_until_it_leaves(link):
    wire, peer = link
    seen = []
    leave = wire.subscribe(lambda message, t_s: seen.append((message.get_type(), t_s)))
    before_s = time.monotonic()
    peer.send(heartbeat())
    await eventually(lambda: seen)
    assert seen[0][0] == "HEARTBEAT"
    assert before_s <= seen[0][1] <= time.monotonic()
    leave()
    good = wire.frames.good
    peer.send(heartbeat())
    await eventually(lambda: wire.frames.good > good)
    assert len(seen) == 1


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


async def test_nothing_is_sent_before_a_vehicle_is_known_or_after_close():
    port = free_port()
    wire = await Wire.open(f"udpin://127.0.0.1:{port}")
    assert not wire.send_setpoint(setpoint(time.monotonic()))
    assert not wire.send_heartbeat()
    await wire.close()
    assert not wire.send_heartbeat()
    assert (wire.counters.sent, wire.counters.unsent) == (0, 3)
    await wire.close()


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


class Loopback:
    """A transport without a socket or an event loop."""

    status, connections = "open", 1

    def __init__(self, received):
        self.received = received
        self.sent = []

    def send(self, data):
        self.sent.append(data)
        return True

    def reply_to(self, peer):
        self.peer = peer


def test_a_wire_runs_over_any_transport_without_a_socket():
    clock, made = FakeClock(5.0), []

    def factory(received):
        made.append(Loopback(received))
        return made[0]

    wire = Wire.over(factory, clock=clock)
    made[0].received(Encoder(1, 1).encode(heartbeat()), ("vehicle", 1))
    assert wire.vehicle.system_id == 1
    assert wire.send_setpoint(setpoint(5.0))
    clock.advance(STALE_S + 1e-6)
    assert not wire.send_setpoint(setpoint(5.0))
    assert len(made[0].sent) == 1


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


async def test_tlog_of_both_directions_opens_in_pymavlink(tmp_path, monkeypatch):
    monkeypatch.setenv("MAVLINK20", "1")
    path, port = tmp_path / "flight.tlog", free_port()
    wire, peer = await Wire.open(f"udpin://127.0.0.1:{port}", tlog=path), Peer(port)
    wall_s = time.time()
    peer.send(heartbeat())
    await wire.wait_vehicle(5.0)
    peer.send_bytes(b"garbage is not logged")
    wire.send_setpoint(setpoint(time.monotonic()))
    raw = Encoder(245, 190).encode(codec.heartbeat())
    wire.send_raw(raw, time.monotonic())
    wire.send_raw(raw, time.monotonic() - 1.0)  # stale: has not left, is not logged
    await wire.close()
    peer.close()
    log = mavutil.mavlink_connection(str(path), dialect="development")
    read = []
    while (message := log.recv_msg()) is not None:
        read.append(message)
    log.close()
    assert [(m.get_type(), m.get_srcSystem()) for m in read] == [
        ("HEARTBEAT", 1),
        ("SET_POSITION_TARGET_LOCAL_NED", 255),
        ("HEARTBEAT", 245),
    ]
    assert all(abs(m._timestamp - wall_s) < 60 for m in read)


async def test_tlog_never_overwrites(tmp_path):
    path = tmp_path / "flight.tlog"
    path.write_bytes(b"an earlier flight")
    with pytest.raises(WireError, match="exists"):
        await Wire.open("udpin://127.0.0.1:0", tlog=path)
    assert path.read_bytes() == b"an earlier flight"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full (Linux)")
async def test_full_disk_ends_the_log_and_not_the_flight(link, caplog):
    wire, peer = link
    full = Path("/dev/full").open("wb", buffering=0)  # noqa: SIM115 (the writer closes it)
    wire._tlog = tlog = TlogWriter(full, "flight.tlog")
    for _ in range(3):
        assert wire.send_heartbeat()
    await eventually(lambda: tlog.dropped == 3)
    await got(peer, "HEARTBEAT")
    (record,) = caplog.records
    assert record.getMessage() == "telemetry log flight.tlog ends here: No space left on device"


def test_loss_is_counted_by_gaps_in_the_window():
    meter = LossMeter(window_s=2.0)
    for now_s, sequence in [(0.0, 254), (0.1, 255), (0.2, 0), (0.3, 3), (0.3, 3), (0.35, 1), (0.4, 4)]:
        meter.update(now_s, sequence)
    assert meter.lost == 2
    assert meter.loss_frac(0.4) == pytest.approx(2 / 7)
    assert meter.loss_frac(2.35) == 0.0
    assert LossMeter().loss_frac(1.0) == 0.0

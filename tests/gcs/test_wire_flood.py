"""More than a link should carry: nothing grows, nobody unknown gets through, the vehicle is still heard."""

from __future__ import annotations

import asyncio
import time
import tracemalloc

from pymavlink.dialects.v20 import development as mav

from gcs.clock import FakeClock
from gcs.framing import MAX_DATAGRAM_BYTES
from gcs.telemetry import Telemetry
from gcs.wire import Wire
from tests.gcs.wire_peer import Loopback, Peer, eventually, free_port, heartbeat

VEHICLE = ("vehicle", 1)


def grown_bytes(work, warm_up: int, count: int) -> int:
    """Memory that calls of work(n) leave behind after a warm-up."""
    for n in range(warm_up):
        work(n)
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    for n in range(warm_up, warm_up + count):
        work(n)
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return after - before


class Flooded:
    """A wire with telemetry, fed 4,000 messages a second of fake time."""

    def __init__(self):
        self.clock = FakeClock(10.0)
        self.wire = Wire.over(self._make, clock=self.clock)
        self.telemetry = Telemetry(self.wire, self.clock)
        self.mav = mav.MAVLink(None, 1, 1)
        self.hear(heartbeat())

    def _make(self, received):
        self.transport = Loopback(received)
        return self.transport

    def hear(self, message):
        frame = message.pack(self.mav)
        self.mav.seq = (self.mav.seq + 1) % 256
        self.transport.received(bytes(frame), VEHICLE)

    def message(self, n):
        kinds = (
            heartbeat(),
            mav.MAVLink_attitude_message(n, 0.1, 0.0, 0.5, 0.0, 0.0, 0.0),
            mav.MAVLink_statustext_message(4, b"x" * 50, n % 65535 + 1, 0),  # whose rest never comes
            mav.MAVLink_command_ack_message(400, 0, 0, 0, 255, 191),
            mav.MAVLink_ping_message(1, n, 0, 0),
        )
        self.clock.advance(1 / 4000)
        self.hear(kinds[n % len(kinds)])


def test_4000_messages_a_second_do_not_fill_the_memory():
    flooded = Flooded()
    assert grown_bytes(flooded.message, 8000, 4000) < 60_000
    figures = flooded.wire.figures(flooded.clock.now_s())
    assert 3900 < figures.received_per_s < 4100  # the flood was one
    assert figures.received_bytes_per_s > 60_000
    assert figures.loss_frac == 0.0


def test_garbage_and_strangers_do_not_fill_the_memory():
    flooded = Flooded()
    stranger = mav.MAVLink(None, 9, 1)
    seen = []
    flooded.wire.subscribe(lambda message, t_s: seen.append(message))
    garbage = b"\xfd\xff\x00" * 20

    def work(n):
        flooded.clock.advance(1 / 4000)
        if n % 2000 == 0:
            flooded.hear(heartbeat())
        flooded.transport.received(bytes(heartbeat().pack(stranger)), ("stranger", n % 60_000))
        flooded.transport.received(garbage, VEHICLE)

    assert grown_bytes(work, 3000, 3000) < 60_000
    assert flooded.wire.counters.foreign_datagrams == 6000
    assert {message.get_srcSystem() for message in seen} == {1}
    assert flooded.wire.vehicle.system_id == 1


async def test_a_stranger_flooding_the_port_does_not_drown_the_vehicle():
    port = free_port()
    wire, peer, stranger = await Wire.open(f"udpin://127.0.0.1:{port}"), Peer(port), Peer(port, 9)
    try:
        peer.send(heartbeat())
        await wire.wait_vehicle(5.0)
        seen = []
        wire.subscribe(lambda message, t_s: seen.append(message.get_srcSystem()))
        frame = stranger.frame(heartbeat())
        for n in range(3000):
            stranger.send_bytes(frame)
            if n % 100 == 0:
                peer.send(heartbeat())
                await asyncio.sleep(0)
        await eventually(lambda: len(seen) == 30)
        assert wire.counters.foreign_datagrams > 2000
        assert set(seen) == {1}
        assert wire.send_heartbeat()
    finally:
        await wire.close()
        peer.close()
        stranger.close()


async def test_oversized_datagrams_are_dropped_whole(link):
    wire, peer = link
    good, frame = wire.frames.good, peer.frame(heartbeat())
    for size in (MAX_DATAGRAM_BYTES + 1, 60_000):
        peer.send_bytes((frame * (size // len(frame) + 1))[:size])
    await eventually(lambda: wire.frames.bad == 2)
    assert wire.frames.good == good
    peer.send(heartbeat())
    await eventually(lambda: wire.frames.good == good + 1)


async def test_bytes_and_rates_are_counted_both_ways(link):
    wire, peer = link
    received, sent = wire.counters.bytes_received, wire.counters.bytes_sent
    frame = peer.frame(heartbeat())
    for _ in range(20):
        peer.send_bytes(frame)
        wire.send_heartbeat()
    await eventually(lambda: wire.counters.bytes_received == received + 20 * len(frame))
    assert wire.counters.bytes_sent == sent + 20 * 21
    figures = wire.figures(time.monotonic())
    assert figures.received_bytes_per_s >= 10 * len(frame)
    assert figures.sent_bytes_per_s == 10 * 21
    assert figures.sent_per_s == 10
    assert figures.totals.bytes_sent == wire.counters.bytes_sent

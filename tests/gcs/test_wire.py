"""The wire over real sockets: what leaves, and that nothing old does."""

from __future__ import annotations

import asyncio
import time

import pytest
from pymavlink.dialects.v20 import development as mav

from control.types import VehicleMode
from gcs import codec
from gcs.clock import FakeClock, MonotonicClock
from gcs.framing import Encoder
from gcs.wire import STALE_S, Wire
from tests.gcs.wire_peer import Loopback, Peer, eventually, free_port, got, heartbeat, setpoint


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


async def test_a_command_decided_before_a_stall_does_not_leave_after_it(link):
    wire, peer = link
    decided_s = time.monotonic()
    command = codec.set_mode(wire.vehicle, VehicleMode.HOLD, armed=True)
    asyncio.get_running_loop().call_soon(wire.send_message, command, decided_s)
    time.sleep(0.15)
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert wire.counters.stale == 1
    assert wire.send_message(command, time.monotonic())
    assert len(await got(peer, "COMMAND_LONG")) == 1


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


async def test_nothing_is_sent_before_a_vehicle_is_known_or_after_close():
    port = free_port()
    wire = await Wire.open(f"udpin://127.0.0.1:{port}")
    assert not wire.send_setpoint(setpoint(time.monotonic()))
    assert not wire.send_heartbeat()
    await wire.close()
    assert not wire.send_heartbeat()
    assert (wire.counters.sent, wire.counters.unsent) == (0, 3)
    await wire.close()


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

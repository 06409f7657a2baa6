"""The traps of MAVSDK, sprung on purpose against the real library: none of them may reach a flight."""

from __future__ import annotations

import asyncio
import gc
import os
import threading
import time

import pytest
from pymavlink.dialects.v20 import development as mav

from control.types import VehicleMode
from gcs.errors import VehicleError
from tests.gcs.vehicle_session import CLOCK, session
from tests.gcs.wire_peer import eventually


async def test_what_mavsdk_makes_during_a_stall_is_dropped():
    async with session("px4", airborne_m=10.0) as s:
        await eventually(lambda: any(m.get_srcSystem() == 245 and m.get_type() == "HEARTBEAT" for _, m in s.arrived))
        sent, send = [], s.wire._transport.send
        s.wire._transport.send = lambda data: (sent.append(data), send(data))[1]
        stale = s.wire.counters.stale
        time.sleep(1.5)  # our loop stands still; MAVSDK's own threads go on making a heartbeat a second
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        assert s.wire.counters.stale > stale
        # Of its heartbeats, one a second, one may have been made in the last 100 ms; it makes other messages too.
        assert sum(frame[5] == 245 and frame[7:10] == bytes(3) for frame in sent) <= 1


async def test_a_cancelled_order_is_waited_for_and_leaves_no_complaint(caplog):
    async with session("px4") as s:
        s.mock.faults.drop_uplink = 1.0
        asking = asyncio.create_task(s.actions.hold())
        await asyncio.sleep(0.1)
        asking.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asking
        t_s = time.monotonic()
        await s.actions.close()
        assert time.monotonic() - t_s > 1.0  # the call, which ends by itself after 2 s, was not cut off
    gc.collect()
    assert caplog.records == []


async def test_other_work_in_the_default_executor_holds_up_neither_orders_nor_setpoints_nor_the_end():
    release = threading.Event()
    async with session("px4", airborne_m=10.0) as s:
        await s.telemetry.wait_for(lambda st: st.position_t_s is not None, 5.0)
        loop = asyncio.get_running_loop()
        jobs = [loop.run_in_executor(None, release.wait) for _ in range(64)]  # more than it has threads
        try:
            assert await s.actions.get_param("COM_OBL_RC_ACT") == 0
            await s.actions.return_to_launch()
            await s.actions.hold()
            s.start_stream()
            await eventually(lambda: len(s.setpoints_from(0.0)) > 10)
            await s.modes.enter_external()
            await s.stop_stream()
            await s.actions.close()
            await s.wire.close()
            assert not any(job.done() for job in jobs)  # it was saturated all the time
        finally:
            release.set()
            await asyncio.gather(*jobs)


async def test_close_waits_for_calls_under_way_and_takes_back_the_others():
    async with session("px4") as s:
        s.mock.faults.drop_uplink = 1.0
        orders = [asyncio.create_task(s.actions.hold()) for _ in range(12)]  # four of them on MAVSDK's threads
        await asyncio.sleep(0.1)
        await s.actions.close()
        results = [str(result) for result in await asyncio.gather(*orders, return_exceptions=True)]
        assert sum("TIMEOUT" in result for result in results) == 4
        assert sum("closed" in result for result in results) == 8
        await s.actions.close()  # again: nothing
    await eventually(lambda: not [thread for thread in threading.enumerate() if thread.name.startswith("mavsdk")])


async def test_after_close_nothing_reaches_mavsdk_any_more():
    async with session("px4") as s:
        link, native = s.actions._link, s.actions._link._mavsdk
        await s.actions.close()
        touched = []
        link._mavsdk = _Tripwire(touched)
        orders = (s.actions.arm(), s.actions.hold(), s.actions.get_param("COM_OF_LOSS_T"), link.system(1.0))
        for order in orders:
            with pytest.raises(VehicleError, match="closed"):
                await order
        heard = s.wire.frames.good
        await eventually(lambda: s.wire.frames.good > heard + 20)
        await link.close()
        assert touched == []
        link._mavsdk = native


class _Tripwire:
    """Stands where the destroyed library was: touching that would have crashed the interpreter."""

    def __init__(self, touched):
        self._touched = touched

    def __getattr__(self, name):
        self._touched.append(name)
        raise AssertionError(f"{name} after destroy")


def _resident_bytes():
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="needs /proc (Linux)")
async def test_feeding_for_long_does_not_fill_the_memory():
    """As much telemetry as of two minutes' flight; no plugin of MAVSDK's is subscribed to any of it."""
    async with session("px4", rates_hz={mav.MAVLINK_MSG_ID_HEARTBEAT: 1.0}) as s:
        link, packer = s.actions._link, mav.MAVLink(None, 1, 1)
        decoder = mav.MAVLink(None)

        async def feed(count):
            for n in range(count):
                kinds = (
                    mav.MAVLink_attitude_message(n, 0.1, 0.0, 0.5, 0.0, 0.0, 0.0),
                    mav.MAVLink_local_position_ned_message(n, 1.0, 2.0, -3.0, 0.0, 0.0, 0.0),
                    mav.MAVLink_statustext_message(6, b"text", 0, 0),
                )
                link._feed(decoder.decode(bytearray(kinds[n % 3].pack(packer))), 0.0)
                packer.seq = (packer.seq + 1) % 256
                if n % 50 == 0:
                    await asyncio.sleep(0)

        await feed(10_000)
        before = _resident_bytes()
        await feed(20_000)
        assert _resident_bytes() - before < 4e6
        assert await s.actions.get_param("COM_OF_LOSS_T") == pytest.approx(1.0)  # it still does its work


async def test_another_component_cannot_answer_for_the_autopilot():
    async with session("px4") as s:
        s.mock.faults.drop_uplink = 1.0
        forger, decoder = mav.MAVLink(None, 1, 25), mav.MAVLink(None)
        ordering = asyncio.create_task(s.actions.hold())
        await asyncio.sleep(0.2)
        ack = mav.MAVLink_command_ack_message(176, 0, 0, 0, 245, 190)
        for subscriber in tuple(s.wire._subscribers):
            subscriber(decoder.decode(bytearray(ack.pack(forger))), CLOCK.now_s())
        with pytest.raises(VehicleError, match="TIMEOUT"):
            await ordering
        assert s.telemetry.vehicle_state().mode is not VehicleMode.UNKNOWN

"""The two mode changes of a follow: believed when seen, never late, never against a pilot."""

from __future__ import annotations

import asyncio

import pytest

from control.types import VehicleMode
from gcs.autopilot.mode_control import ModeControl
from gcs.errors import VehicleError
from tests.gcs.recording_wire import ack
from tests.gcs.wire_peer import PX4_LOITER, PX4_OFFBOARD, PX4_POSCTL, heartbeat


async def test_an_old_sight_of_the_mode_does_not_confirm_a_new_command(wire, telemetry, clock):
    wire.hear(heartbeat(custom_mode=PX4_OFFBOARD), 99.0)
    entering = asyncio.create_task(ModeControl(wire, telemetry, clock).enter_external())
    await asyncio.sleep(0)
    assert wire.sent[0].command == 176
    await asyncio.sleep(0.01)
    assert not entering.done()
    wire.hear(heartbeat(custom_mode=PX4_OFFBOARD), 100.1)
    await entering
    assert len(wire.sent) == 1


async def test_hold_gives_way_to_a_pilot(wire, telemetry, clock):
    wire.hear(heartbeat(custom_mode=PX4_OFFBOARD), 99.0)
    holding = asyncio.create_task(ModeControl(wire, telemetry, clock).hold())
    await asyncio.sleep(0)
    wire.hear(heartbeat(custom_mode=PX4_POSCTL), 100.1)
    assert await holding is VehicleMode.MANUAL
    assert len(wire.sent) == 1


async def test_hold_is_confirmed_by_the_mode_not_by_the_answer(wire, telemetry, clock):
    wire.hear(heartbeat(custom_mode=PX4_OFFBOARD), 99.0)
    holding = asyncio.create_task(ModeControl(wire, telemetry, clock).hold())
    await asyncio.sleep(0)
    wire.hear(ack(176, 0), 100.05)
    await asyncio.sleep(0.01)
    assert not holding.done()
    wire.hear(heartbeat(custom_mode=PX4_LOITER), 100.1)
    assert await holding is VehicleMode.HOLD


async def test_a_mode_asked_for_before_a_stall_is_not_asked_for_after_it(wire, telemetry, clock):
    wire.hear(heartbeat(custom_mode=PX4_LOITER), 99.0)
    entering = ModeControl(wire, telemetry, clock).enter_external(asked_t_s=clock.now_s())
    clock.advance(0.11)  # between the decision and the first step of its task
    with pytest.raises(VehicleError, match="not asked for: this computer stalled"):
        await entering
    assert wire.sent == []


async def test_a_late_hold_looks_first_whether_the_pilot_has_it(wire, telemetry, clock):
    wire.hear(heartbeat(custom_mode=PX4_OFFBOARD), 99.0)
    holding = asyncio.create_task(ModeControl(wire, telemetry, clock).hold(asked_t_s=100.0))
    clock.advance(2.0)
    await asyncio.sleep(0)
    wire.hear(heartbeat(custom_mode=PX4_POSCTL), 102.0)  # was waiting in the socket
    assert await holding is VehicleMode.MANUAL
    assert wire.sent == []


async def test_a_late_hold_is_still_sent_to_a_vehicle_that_is_ours(wire, telemetry, clock):
    wire.hear(heartbeat(custom_mode=PX4_OFFBOARD), 99.0)
    holding = asyncio.create_task(ModeControl(wire, telemetry, clock).hold(asked_t_s=100.0))
    clock.advance(2.0)
    await asyncio.sleep(0.05)
    assert [m.command for m in wire.sent] == [176]
    wire.hear(heartbeat(custom_mode=PX4_LOITER), 102.1)
    assert await holding is VehicleMode.HOLD

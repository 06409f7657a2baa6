"""How a flight ends, whatever ends it: zero, the vehicle's hold mode, silence; only where the vehicle is ours."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Final

from control.checks import fresh
from control.engagement import MODE_AGE_S, Action
from control.gate import TICK_S
from control.types import VehicleMode

if TYPE_CHECKING:
    from gcs.flight import Flight

_ZEROS: Final = 3


async def leave(flight: Flight) -> None:
    """Stop a vehicle that is ours; the control task has ended by now."""
    tick = flight.tick
    ours = flight.control.is_engaged or (tick is not None and tick.output.action is Action.COMMAND_HOLD)
    mode = flight.link.telemetry.vehicle_state().mode
    if not ours or mode not in (VehicleMode.EXTERNAL, VehicleMode.HOLD):
        return
    for _ in range(_ZEROS):
        _send_zero(flight)
        await asyncio.sleep(TICK_S)
    holding = asyncio.create_task(flight.modes.hold())
    while not holding.done():
        # Where the mode is not heard, it may long be holding or be a pilot's.
        if fresh(flight.link.telemetry.vehicle_state().mode_t_s, flight.clock.now_s(), MODE_AGE_S):
            _send_zero(flight)
        await asyncio.wait([holding], timeout=TICK_S)


def _send_zero(flight: Flight) -> None:
    setpoint = flight.control.zero(flight.clock.now_s(), flight.link.telemetry.vehicle_state())
    if setpoint is not None:
        flight.output.stop(setpoint)

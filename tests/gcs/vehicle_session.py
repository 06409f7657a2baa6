"""A station on one side, a mock vehicle on the other, real UDP between them."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mav

from control.fence import Fence
from control.gate import Limits, Reason, gate
from control.types import Vec3, VehicleMode, VelocityRequest
from gcs.autopilot.actions import VehicleActions
from gcs.autopilot.mode_control import ModeControl
from gcs.clock import MonotonicClock
from gcs.signing import Signing
from gcs.telemetry import Telemetry
from gcs.wire import Wire
from sitl_mocks.vehicle import MockVehicle
from sitl_mocks.vehicle.server import run_udp
from tests.gcs.wire_peer import free_port

CLOCK = MonotonicClock()
BOTH = pytest.mark.parametrize("personality", ["px4", "ardupilot"])


@dataclass
class Session:
    """A station on one side, a mock vehicle on the other, and what the vehicle saw arrive."""

    mock: MockVehicle
    wire: Wire
    telemetry: Telemetry
    actions: VehicleActions
    modes: ModeControl
    arrived: list[tuple[float, Any]] = field(default_factory=list)
    streamer: asyncio.Task[None] | None = None
    velocity: Vec3 = (0.0, 0.0, 0.0)
    reasons: set[Reason] = field(default_factory=set)

    def start_stream(self) -> None:
        self.streamer = asyncio.create_task(self._stream())

    async def stop_stream(self) -> None:
        assert self.streamer is not None
        self.streamer.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self.streamer

    async def _stream(self) -> None:
        """The control task in small: 20 Hz through the real gate, heartbeats from the same task."""
        previous, tick = None, 0
        while True:
            if tick % 20 == 0:
                self.wire.send_heartbeat()
            tick += 1
            now_s, state = CLOCK.now_s(), self.telemetry.vehicle_state()
            priming = state.mode is not VehicleMode.EXTERNAL
            request = VelocityRequest(now_s, self.velocity, 0.0, priming=priming)
            limits = Limits(fence=Fence(min_height_m=1.5))
            previous, reason = gate(request, state, now_s, previous, limits)
            self.reasons.add(reason)
            if previous is not None:
                self.wire.send_setpoint(previous)
            await asyncio.sleep(0.05)

    def setpoints_from(self, t_s: float) -> list[Any]:
        return [m for t, m in self.arrived if t >= t_s and m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]

    async def reached(self, mode: VehicleMode) -> None:
        assert await self.telemetry.wait_for(lambda s: s.mode is mode, 5.0), self.telemetry.vehicle_state()


@contextlib.asynccontextmanager
async def session(personality: str, *, signing: Signing | None = None, **vehicle: Any) -> AsyncIterator[Session]:
    """A vehicle heard on a wire and MAVSDK attached to it; everything closed in order afterwards."""
    port, mock = free_port(), MockVehicle(personality, **vehicle)
    arrived: list[tuple[float, Any]] = []
    parser = mav.MAVLink(None)

    def observe(datagram: bytes, now_s: float) -> None:
        arrived.extend((now_s, message) for message in parser.parse_buffer(datagram) or [])

    wire = await Wire.open(f"udpin://127.0.0.1:{port}", signing=signing)
    flying = asyncio.create_task(run_udp(mock, ("127.0.0.1", port), observe=observe))
    telemetry = Telemetry(wire, CLOCK)
    asking = asyncio.create_task(telemetry.run())
    actions = None
    try:
        await wire.wait_vehicle(5.0)
        actions = await VehicleActions.attach(wire, telemetry, CLOCK)
        modes = ModeControl(wire, telemetry, CLOCK)
        yield Session(mock, wire, telemetry, actions, modes, arrived)
    finally:
        if actions is not None:
            await actions.close()
        for task in (asking, flying):
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task
        telemetry.close()
        await wire.close()

"""A real MAVSDK over real UDP flies both personalities: connect, arm, take off, hold, land, parameters."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncGenerator, AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from typing import Any

import pytest
from mavsdk import log_subscribe
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.action import ActionError

from sitl_mocks.vehicle import MockVehicle, Mode, Personality
from sitl_mocks.vehicle.server import run_udp

pytestmark = pytest.mark.slow

PARAMETERS = {
    Personality.PX4: {"MPC_TKO_SPEED": 3.0, "MPC_LAND_SPEED": 1.5, "COM_DISARM_LAND": 0.2, "COM_SPOOLUP_TIME": 0.1},
    Personality.ARDUPILOT: {"LAND_SPEED": 150.0, "WPNAV_SPEED_UP": 400.0},
}


def free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


async def wait_for(stream: AsyncGenerator[Any, None], wanted: Callable[[Any], bool], timeout_s: float = 10.0) -> Any:
    async def first() -> Any:
        async for value in stream:
            if wanted(value):
                return value
        raise AssertionError("the stream ended")

    try:
        return await asyncio.wait_for(first(), timeout_s)
    finally:
        await stream.aclose()


@asynccontextmanager
async def flying(vehicle: MockVehicle) -> AsyncIterator[Any]:
    """MAVSDK's system connected to the vehicle; destroyed once, after the vehicle's task has ended."""
    log_subscribe(lambda *_: True)
    port = free_udp_port()
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    await mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
    task = asyncio.create_task(run_udp(vehicle, ("127.0.0.1", port)))
    try:
        system = await mavsdk.first_autopilot(timeout_s=5.0)
        assert system is not None
        yield system
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        mavsdk.destroy()


async def request_streams(telemetry: TelemetryAsync) -> None:
    """ArduCopter streams nothing by itself, and MAVSDK does not ask."""
    await telemetry.set_rate_position(10.0)
    await telemetry.set_rate_in_air(10.0)
    await telemetry.set_rate_rc_status(5.0)  # SYS_STATUS


@pytest.mark.parametrize("personality", list(Personality))
async def test_mavsdk_flies_it(personality: Personality) -> None:
    vehicle = MockVehicle(personality, parameters=PARAMETERS[personality])
    async with flying(vehicle) as system:
        telemetry, action = TelemetryAsync(system), ActionAsync(system)
        if personality is Personality.ARDUPILOT:
            await request_streams(telemetry)
        assert await wait_for(telemetry.subscribe_health_all_ok(), bool)
        await action.set_takeoff_altitude(1.5)
        await check_refusal(vehicle, action)
        if personality is Personality.ARDUPILOT:
            vehicle.pilot_sets_mode(Mode.EXTERNAL)
        await action.arm()
        assert vehicle.autopilot.armed
        await action.takeoff()
        await wait_for(telemetry.subscribe_position(), lambda p: p.relative_altitude_m > 1.2)
        assert await wait_for(telemetry.subscribe_in_air(), bool)
        await action.hold()
        assert vehicle.autopilot.mode in (Mode.HOLD, Mode.BRAKE)
        await action.land()
        await wait_for(telemetry.subscribe_armed(), lambda armed: not armed)
        assert not vehicle.autopilot.flight.flying


async def check_refusal(vehicle: MockVehicle, action: ActionAsync) -> None:
    vehicle.autopilot.ready, ready_t_s = False, vehicle.autopilot.ready_t_s
    vehicle.autopilot.ready_t_s = float("inf")
    with pytest.raises(ActionError):
        await action.arm()
    assert not vehicle.autopilot.armed
    vehicle.autopilot.ready, vehicle.autopilot.ready_t_s = True, ready_t_s


@pytest.mark.parametrize(
    ("personality", "real", "integer"),
    [(Personality.PX4, "COM_OF_LOSS_T", "COM_OBL_RC_ACT"), (Personality.ARDUPILOT, "GUID_TIMEOUT", "FS_GCS_ENABLE")],
)
async def test_mavsdk_reads_and_sets_parameters(personality: Personality, real: str, integer: str) -> None:
    vehicle = MockVehicle(personality)
    async with flying(vehicle) as system:
        params = ParamAsync(system)
        assert await params.get_param_float(real) == vehicle.params[real]
        assert await params.get_param_int(integer) == 0
        await params.set_param_int(integer, 5)
        assert vehicle.params[integer] == 5.0
        assert await params.get_param_int(integer) == 5
        await params.set_param_float(real, 0.5)
        assert vehicle.params[real] == 0.5
        everything = await params.get_all_params()
        assert len(everything.int_params) + len(everything.float_params) == len(vehicle.params)

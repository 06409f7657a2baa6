"""The MAVLink camera of a flight: on the vehicle's own system, beside the cameras that it already has."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from gcs.errors import GcsError
from gcs.flight import Flight
from gcs.flight_place import place_of
from gcs.flight_station import FlightStation
from gcs.framing import Message
from gcs.operator.camera.server import CameraServer
from gcs.operator.camera.setup import COMPONENT_IDS, camera_setup
from gcs.operator.lease import Lease

_LISTEN_S: Final = 1.5  # a camera says that it is there once a second


async def run_camera(
    flight: Flight,
    station: FlightStation,
    lease: Lease,
    say: Callable[[str], None],
    *,
    stream_url: str | None = None,
    definition_url: str | None = None,
) -> None:
    """Be the camera that the configuration wants, for ever; where it cannot be, say so and leave the flight alone."""
    config = flight.config.mavlink_camera
    if config.url is None:
        return
    system_id = flight.link.telemetry.vehicle.system_id
    heard = await _cameras_heard(flight, system_id)
    try:
        setup = replace(
            camera_setup(flight.config, system_id, heard),
            stream_url=stream_url,
            rendered=flight.config.video_out.annotated,
            bitrate_kbps=flight.config.video_out.bitrate_kbps,
            definition_url=definition_url,
        )
        server = await CameraServer.open(config.url, setup, station, lease, flight.clock, lambda: place_of(flight), say)
    except GcsError as error:
        say(f"no MAVLink camera: {error}")
        return
    say(f"MAVLink camera {setup.system_id}/{setup.component_id} at {config.url}")
    async with server:
        await server.run()


async def _cameras_heard(flight: Flight, system_id: int) -> set[int]:
    """Component ids of cameras on the vehicle's own link."""
    heard: set[int] = set()

    def listen(message: Message, t_s: float) -> None:
        if message.get_type() == "HEARTBEAT" and message.get_srcSystem() == system_id:
            heard.add(message.get_srcComponent())

    end = flight.link.wire.subscribe(listen)
    try:
        await asyncio.sleep(_LISTEN_S)
    finally:
        end()
    return heard & set(COMPONENT_IDS)

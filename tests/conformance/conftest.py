"""Our camera on a real socket, before a station without a flight."""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass

import pytest

from gcs.clock import MonotonicClock
from gcs.operator.camera.server import CameraServer
from gcs.operator.camera.setup import CameraSetup, TargetPlace
from gcs.operator.lease import Lease
from tests.conformance.client import Client
from tests.gcs.fake_station import FakeStation
from tests.gcs.wire_peer import free_port

SYSTEM_ID = 7
slow = pytest.mark.skipif("CONFORMANCE_ALL" not in os.environ, reason="CONFORMANCE_ALL=1 runs what takes seconds")


@dataclass
class Camera:
    station: FakeStation
    lease: Lease
    port: int
    setup: CameraSetup

    @property
    def url(self) -> str:
        """Where a client finds it."""
        return f"udpout://127.0.0.1:{self.port}"


@contextlib.asynccontextmanager
async def running_camera(url: str | None = None, fps: float = 50.0, **how: object) -> AsyncIterator[Camera]:
    """udpin on a free port, or at this address."""
    station, lease, port = FakeStation(size=(320, 240)), Lease(), free_port()
    known: dict[str, object] = {
        "stream_url": "rtsp://127.0.0.1:8554/live", "rendered": True, "may_follow": True, "display_delay_s": 0.0,
        "definition_url": "http://127.0.0.1:8870/camera.xml",
    }  # fmt: skip
    setup = CameraSetup(SYSTEM_ID, **{**known, **how})  # type: ignore[arg-type]
    place = TargetPlace(47.4, 8.5, 488.0, (1.0, 0.0, 0.0), 15.0)
    camera = await CameraServer.open(
        url or f"udpin://127.0.0.1:{port}", setup, station, lease, MonotonicClock(), lambda: place
    )
    async with camera:
        station.show()
        tasks = [asyncio.create_task(each) for each in (camera.run(), station.run(fps))]
        try:
            yield Camera(station, lease, port, camera.setup)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)


@pytest.fixture
async def camera() -> AsyncIterator[Camera]:
    async with running_camera() as running:
        yield running


@pytest.fixture
async def new_client(camera: Camera) -> AsyncIterator[Callable[..., Awaitable[Client]]]:
    """Makes clients that have found the camera."""
    made: list[Client] = []

    async def make(system_id: int = 255, component_id: int = 190) -> Client:
        client = await Client.open(camera.url, system_id, component_id)
        made.append(client)
        await client.find_camera()
        return client

    yield make
    for client in made:
        client.close()


@pytest.fixture
async def client(new_client: Callable[..., Awaitable[Client]]) -> Client:
    return await new_client()

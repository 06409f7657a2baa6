"""Our camera as the camera plugin of the real MAVSDK sees it, over real sockets."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator

import mavsdk
import pytest
from aiohttp import web
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.camera import CameraAsync
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync
from mavsdk.plugins.camera import CameraError
from mavsdk.plugins.mavlink_direct import MavlinkMessage

from gcs.operator.camera.definition import routes
from gcs.operator.camera.server import definition_of
from gcs.operator.camera.setup import CameraSetup
from gcs.operator.orders import Deselect, Record, Select, SelectPoint
from tests.conformance.conftest import SYSTEM_ID, Camera, running_camera, slow

COMPONENT_ID = 100
TRACKING = "CAMERA_TRACKING_IMAGE_STATUS"


class Seen:
    """A MAVSDK that has found the camera; no autopilot is needed for that."""

    def __init__(self, camera: Camera, system: object) -> None:
        self.ours = camera
        self.plugin = CameraAsync(system)
        self.direct = MavlinkDirectAsync(system)


@pytest.fixture
async def definition_url(tmp_path, monkeypatch) -> AsyncIterator[str]:
    monkeypatch.setenv("HOME", str(tmp_path))  # MAVSDK keeps what it has downloaded there
    app = web.Application()
    app.add_routes(routes(definition_of(CameraSetup(SYSTEM_ID, may_follow=True))))
    runner = web.AppRunner(app)
    await runner.setup()
    site = web.TCPSite(runner, "127.0.0.1", 0)
    await site.start()
    yield f"http://127.0.0.1:{runner.addresses[0][1]}/camera.xml"
    await runner.cleanup()


@pytest.fixture
async def seen(definition_url) -> AsyncIterator[Seen]:
    mavsdk.log_subscribe(lambda *_: True)  # it would print to standard output
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with running_camera(definition_url=definition_url) as camera, Mavsdk(configuration) as kit:
        await kit.add_any_connection(camera.url)
        async with asyncio.timeout(10):
            while not (systems := await kit.get_systems()):
                await asyncio.sleep(0.02)
            found = Seen(camera, systems[0])
            while not (await found.plugin.camera_list()).cameras:
                await asyncio.sleep(0.02)
        yield found


async def test_everything_that_mavsdk_can_ask_of_a_camera(seen):
    plugin, station = seen.plugin, seen.ours.station
    (camera,) = (await plugin.camera_list()).cameras
    assert (camera.component_id, camera.vendor_name, camera.model_name) == (COMPONENT_ID, "ClimRT", "Tracking camera")
    assert (camera.horizontal_resolution_px, camera.vertical_resolution_px) == (320, 240)

    await plugin.track_rectangle(COMPONENT_ID, 0.25, 0.25, 0.5, 0.75)
    await plugin.track_point(COMPONENT_ID, 0.5, 0.5, 0.1)
    await plugin.track_stop(COMPONENT_ID)
    await plugin.stop_video(COMPONENT_ID)
    await plugin.start_video(COMPONENT_ID)
    assert [type(order) for order in station.orders] == [Select, SelectPoint, Deselect, Record, Record]
    assert station.orders[0].box.xywh == (80, 60, 80, 120)
    with pytest.raises(CameraError, match="DENIED"):
        await plugin.track_rectangle(COMPONENT_ID, 0.5, 0.25, 0.25, 0.75)

    settings = {each.setting_id: each for each in await _until_found(plugin.get_current_settings, COMPONENT_ID)}
    assert {"FOLLOW", "FOLLOW_MODE", "FOLLOW_STANDOFF"} <= set(settings)
    assert settings["FOLLOW_MODE"].option.option_description == "Follow"

    statuses = seen.direct.subscribe_message(TRACKING)
    await seen.direct.send_message(_interval(275, 50_000))
    await plugin.track_rectangle(COMPONENT_ID, 0.4, 0.4, 0.6, 0.65)
    status = await _status(statuses, 1)
    assert status["tracking_mode"] == 2
    assert 0 <= status["rec_top_x"] < status["rec_bottom_x"] <= 1
    station.visible = False
    await _status(statuses, 9)
    await plugin.track_stop(COMPONENT_ID)
    assert (await _status(statuses, 0))["tracking_mode"] == 0


@slow  # MAVSDK looks at streams every few seconds
async def test_the_address_of_the_video(seen):
    async with asyncio.timeout(20):
        while not (stream := await seen.plugin.get_video_stream_info(COMPONENT_ID)).settings.uri:
            await asyncio.sleep(0.05)
    assert stream.settings.uri == "rtsp://127.0.0.1:8554/live"
    assert (stream.settings.horizontal_resolution_pix, stream.settings.vertical_resolution_pix) == (320, 240)


def _interval(message_id: int, period_us: int) -> MavlinkMessage:
    fields = {
        "target_system": SYSTEM_ID, "target_component": COMPONENT_ID, "command": 511, "confirmation": 0,
        "param1": message_id, "param2": period_us, "param3": 0, "param4": 0, "param5": 0, "param6": 0, "param7": 0,
    }  # fmt: skip
    return MavlinkMessage("COMMAND_LONG", 245, 190, SYSTEM_ID, COMPONENT_ID, json.dumps(fields))


async def _status(statuses, wanted: int) -> dict[str, object]:
    async with asyncio.timeout(5):
        async for message in statuses:
            fields = json.loads(message.fields_json)
            if fields["tracking_status"] == wanted:
                return fields
    raise AssertionError("the subscription ended")


async def _until_found(ask, *args):
    async with asyncio.timeout(5):
        while not (found := await ask(*args)):
            await asyncio.sleep(0.02)
    return found

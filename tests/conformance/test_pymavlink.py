"""Our camera against the checks of a stranger, and what only a station in the hand can show."""

from __future__ import annotations

import struct
from dataclasses import replace

import pytest

from control.engagement import State
from gcs.errors import SelectionError
from gcs.operator.orders import Abort, Confirm, Deselect, Record, Select, SelectPoint, SetMode, SetStandoff
from tests.conformance import checks
from tests.conformance.acts import BOX, read_parameters, selected, set_parameter
from tests.conformance.checks import NotApplicableError
from tests.conformance.client import ACCEPTED, DENIED, REJECTED, Client, value_bytes
from tests.conformance.conftest import SYSTEM_ID, running_camera, slow


@pytest.mark.parametrize("check", checks.CHECKS, ids=lambda check: check.__name__)
async def test_check(check, client):
    await check(client)


@slow
@pytest.mark.parametrize("check", checks.SLOW_CHECKS, ids=lambda check: check.__name__)
async def test_slow_check(check, client):
    await check(client)


async def test_it_is_a_camera_of_the_vehicle(client):
    assert client.camera == (SYSTEM_ID, 100)


async def test_flags_and_definition(client, camera):
    info = await client.request(259, "CAMERA_INFORMATION")
    assert info.flags == 1 | 256 | 512 | 1024 | 2048
    assert info.cam_definition_uri == camera.setup.definition_url
    assert info.cam_definition_version == camera.setup.definition_version > 0


async def test_rectangle_and_point_reach_the_station_in_pixels(client, camera):
    await client.command(2005, 0.25, 0.25, 0.5, 0.75)
    await client.command(2004, 1.0, 0.5, 0.1)
    await client.command(2010)
    select, point, drop = camera.station.orders
    assert isinstance(select, Select)
    assert select.box.xywh == (80, 60, 80, 120)
    assert isinstance(point, SelectPoint)
    assert (point.x_px, point.y_px, point.radius_px) == (319, 120, pytest.approx(32))
    assert isinstance(drop, Deselect)


async def test_coasting_then_lost_then_seen_again(client, camera):
    station = camera.station
    status = await selected(client)
    assert status.tracking_status == 1
    assert status.target_data == 2 | 4
    station.visible = False
    status = await client.tracking(lambda m: m.tracking_status == 9)
    assert status.tracking_mode == 2
    station.base = replace(station.base, state=State.LOST_HOLD)
    status = await client.tracking(lambda m: m.tracking_status == 0)
    assert status.tracking_mode == 0
    station.visible = True
    await client.tracking(lambda m: m.tracking_status == 1)
    station.base = replace(station.base, state=State.SELECTED)
    await client.command(2010)
    await client.tracking(lambda m: m.tracking_status == 0)


async def test_twice_the_same_is_done_once(client, camera):
    for confirmation in (0, 0, 1):
        client.send(client.long(2005, *BOX, confirmation=confirmation))
    since = len(client.heard)
    await client.acknowledged(2005, since)
    assert await client.command(2005, *BOX, confirmation=2) == ACCEPTED
    assert len(camera.station.orders) == 1
    await client.command(2010)
    assert await client.command(2005, *BOX) == ACCEPTED
    assert len(camera.station.orders) == 3


async def test_another_holder_of_the_lease(client, camera):
    assert camera.lease.take("page 1", camera.station.now_s())
    since = len(client.heard)
    assert await client.command(2005, *BOX) == REJECTED
    text = await client.wait("STATUSTEXT", since=since)
    assert text.text == "page 1 is in control"
    assert not camera.station.orders


async def test_no_selection_while_following(client, camera):
    camera.station.base = replace(camera.station.base, state=State.FOLLOWING)
    since = len(client.heard)
    for number, params in ((2005, BOX), (2004, (0.5, 0.5)), (2010, ())):
        assert await client.command(number, *params) == REJECTED
    assert "abort first" in (await client.wait("STATUSTEXT", since=since)).text
    assert not camera.station.orders


async def test_what_the_station_refuses_is_denied_with_its_reason(client, camera, monkeypatch):
    async def refuse(order):
        raise SelectionError("the box is only 3x3 px: draw it round the whole object, from one edge to the other one")

    monkeypatch.setattr(camera.station, "perform", refuse)
    since = len(client.heard)
    assert await client.command(2005, *BOX) == DENIED
    first = await client.wait("STATUSTEXT", lambda m: m.id and m.chunk_seq == 0, since)
    second = await client.wait("STATUSTEXT", lambda m: m.id == first.id and m.chunk_seq == 1, since)
    assert first.text + second.text == (
        "the box is only 3x3 px: draw it round the whole object, from one edge to the other one"
    )


async def test_parameters_order_mode_standoff_and_following(client, camera):
    station = camera.station
    values = {value.param_id: value for value in await read_parameters(client)}
    assert list(values) == ["FOLLOW_MODE", "FOLLOW_STANDOFF", "HEIGHT", "SPEED", "FOLLOW"]
    assert struct.unpack_from("<f", value_bytes(values["HEIGHT"])) == (10.0,)
    assert (await set_parameter(client, "FOLLOW_MODE", b"\0", 1)).param_result == 0
    assert (await set_parameter(client, "FOLLOW_STANDOFF", struct.pack("<f", 12.5), 9)).param_result == 0
    assert (await set_parameter(client, "FOLLOW_STANDOFF", struct.pack("<f", float("nan")), 9)).param_result == 1
    assert (await set_parameter(client, "FOLLOW_MODE", b"\x63", 1)).param_result == 1
    assert (await set_parameter(client, "HEIGHT", struct.pack("<f", 50.0), 9)).param_result == 1
    await selected(client)
    assert (await set_parameter(client, "FOLLOW", b"\1", 1)).param_result == 0
    await client.wait("PARAM_EXT_VALUE", lambda m: m.param_id == "FOLLOW" and value_bytes(m)[0] == 1)
    assert (await set_parameter(client, "FOLLOW", b"\0", 1)).param_result == 0
    kinds = [type(order) for order in station.orders if not isinstance(order, Select | Deselect)]
    assert kinds == [SetMode, SetStandoff, Confirm, Abort]


async def test_a_refused_start_of_following_is_told_as_a_value_that_cannot_be(client, camera):
    camera.station.refused = ("no GPS",)
    ack = await set_parameter(client, "FOLLOW", b"\1", 1)
    assert (ack.param_result, value_bytes(ack)[0]) == (1, 0)


async def test_following_ends_from_here_whoever_is_in_control(client, camera):
    camera.lease.take("page 1", camera.station.now_s())
    assert (await set_parameter(client, "FOLLOW", b"\0", 1)).param_result == 0
    assert camera.station.orders == [Abort()]
    assert (await set_parameter(client, "FOLLOW", b"\1", 1)).param_result == 1
    assert camera.station.orders == [Abort()]


async def test_films(client, camera):
    camera.station.base = replace(camera.station.base, recording=False)
    assert await client.command(2500, 0, 0) == ACCEPTED
    assert camera.station.orders == [Record(True)]


async def test_two_clients_are_both_answered_and_streamed_to(client, new_client, camera):
    other = await new_client(254, 1)
    assert await client.command(511, 275, 50_000) == ACCEPTED
    await other.request(259, "CAMERA_INFORMATION")
    assert await other.command(511, 275, 100_000) == ACCEPTED
    for each in (client, other):
        await each.tracking(lambda m: True)
    since = len(other.heard)
    assert await client.command(511, 275, -1) == ACCEPTED
    await other.tracking(lambda m: True)
    assert await client.command(2005, *BOX) == ACCEPTED
    await other.tracking(lambda m: m.tracking_status == 1)
    assert await other.command(2010) == REJECTED  # the first one is in control
    mine = {(m.target_system, m.target_component) for m in other.heard[since:] if m.get_type() == "COMMAND_ACK"}
    assert mine == {(254, 1)}


async def test_without_stream_place_and_definition_nothing_is_claimed():
    async with running_camera(stream_url=None, definition_url=None, may_follow=False) as camera:
        client = await Client.open(camera.url)
        await client.find_camera()
        info = await client.request(259, "CAMERA_INFORMATION")
        assert not info.flags & 256
        assert info.cam_definition_uri == ""
        with pytest.raises(NotApplicableError):
            await checks.video_stream(client)
        assert "FOLLOW" not in [value.param_id for value in await read_parameters(client)]
        assert (await set_parameter(client, "FOLLOW", b"\1", 1)).param_result != 0
        assert not camera.station.orders
        client.close()


async def test_it_may_speak_first():
    listening = await Client.open("udpin://127.0.0.1:0")
    port = listening._socket.get_extra_info("sockname")[1]
    async with running_camera(f"udpout://127.0.0.1:{port}"):
        assert await listening.find_camera() == (SYSTEM_ID, 100)
        await checks.track_rectangle(listening)
    listening.close()

"""What a client may expect of a MAVLink camera that tracks; each check is one sentence, true or not.

They need a camera that shows a picture and follows nothing. `NotApplicableError`: it does not claim to have that.
"""

from __future__ import annotations

import asyncio
import math
import struct
import time
from collections.abc import Awaitable, Callable
from typing import Any

from tests.conformance.acts import BOX, fresh, read_parameters, selected, set_parameter, stop
from tests.conformance.client import ACCEPTED, DENIED, NAN, RESULTS, UNSUPPORTED, Client, mavlink, value_bytes

INF = math.inf
STREAM, POINT, RECTANGLE, GEO, VIDEO = 256, 512, 1024, 2048, 1


class NotApplicableError(Exception):
    """The camera does not claim it."""


async def heartbeat_once_a_second(client: Client) -> None:
    """HEARTBEAT as MAV_TYPE_CAMERA without autopilot, component 100 to 105, about once a second."""
    first = await client.wait("HEARTBEAT", _of(client), len(client.heard))
    begun_s = time.monotonic()
    await client.wait("HEARTBEAT", _of(client), len(client.heard))
    took_s = time.monotonic() - begun_s
    assert (first.type, first.autopilot) == (30, 8)
    assert 100 <= first.get_srcComponent() <= 105
    assert 0.5 < took_s < 2.0, f"{took_s:.2f} s between heartbeats"


async def information_by_521_and_512(client: Client) -> None:
    """CAMERA_INFORMATION by 521 and by 512, the same, with size and flags of a tracking camera."""
    old = await client.asked(521, "CAMERA_INFORMATION", 1)
    new = await client.request(259, "CAMERA_INFORMATION")
    ignored = ("time_boot_ms", "mavpackettype")
    a, b = ({k: repr(v) for k, v in m.to_dict().items() if k not in ignored} for m in (old, new))
    assert a == b, f"{a} is not {b}"
    assert new.flags & POINT, "flags lack HAS_TRACKING_POINT"
    assert new.flags & RECTANGLE, "flags lack HAS_TRACKING_RECTANGLE"
    assert new.resolution_h > 0
    assert new.resolution_v > 0
    assert any(new.vendor_name)
    assert any(new.model_name)


async def settings_storage_capture(client: Client) -> None:
    """CAMERA_SETTINGS, STORAGE_INFORMATION and CAMERA_CAPTURE_STATUS by 512 and by their older commands."""
    for number, params, message_id, kind in (
        (522, (1,), 260, "CAMERA_SETTINGS"),
        (525, (0, 1), 261, "STORAGE_INFORMATION"),
        (527, (1,), 262, "CAMERA_CAPTURE_STATUS"),
    ):
        await client.asked(number, kind, *params)
        await client.request(message_id, kind)


async def field_of_view(client: Client) -> None:
    """CAMERA_FOV_STATUS with believable angles of the picture's shape."""
    fov, info = await client.request(271, "CAMERA_FOV_STATUS"), await client.request(259, "CAMERA_INFORMATION")
    assert 5 < fov.hfov < 175
    assert 5 < fov.vfov < 175
    shape = math.tan(math.radians(fov.vfov) / 2) / math.tan(math.radians(fov.hfov) / 2)
    assert math.isclose(shape, info.resolution_v / info.resolution_h, rel_tol=0.02)


async def video_stream(client: Client) -> None:
    """VIDEO_STREAM_INFORMATION and _STATUS by 512, 2504 and 2505, if the flag says so; denied if not."""
    info = await client.request(259, "CAMERA_INFORMATION")
    if not info.flags & STREAM:
        assert await client.command(2504, 0) != ACCEPTED
        assert await client.command(512, 269) != ACCEPTED
        raise NotApplicableError("no video stream")
    stream = await client.request(269, "VIDEO_STREAM_INFORMATION")
    assert stream.count >= 1
    assert stream.uri
    assert (stream.resolution_h, stream.resolution_v) == (info.resolution_h, info.resolution_v)
    await client.request(269, "VIDEO_STREAM_INFORMATION", stream.stream_id)
    await client.asked(2504, "VIDEO_STREAM_INFORMATION", stream.stream_id)
    await client.asked(2505, "VIDEO_STREAM_STATUS", stream.stream_id)
    await client.request(270, "VIDEO_STREAM_STATUS", 0)
    assert await client.command(2504, 77) == DENIED


async def camera_mode(client: Client) -> None:
    """SET_CAMERA_MODE to what CAMERA_SETTINGS says is accepted, to none that exists is denied."""
    settings = await client.request(260, "CAMERA_SETTINGS")
    assert await client.command(530, 0, settings.mode_id) == ACCEPTED
    assert await client.command(530, 0, 55) == DENIED


async def track_rectangle(client: Client) -> None:
    """2005 selects: 275 then comes ACTIVE with a rectangle inside the picture."""
    await selected(client)


async def track_point(client: Client) -> None:
    """2004 selects, with a radius, with 0 and with NaN."""
    await fresh(client)
    for radius in (0.05, 0.0, NAN):
        assert await client.command(2004, 0.5, 0.5, radius) == ACCEPTED
    status = await client.tracking(lambda m: m.tracking_status & 1)
    assert status.tracking_mode in (1, 2)
    await stop(client)


async def stop_tracking(client: Client) -> None:
    """After 2010 the status is IDLE and its mode NONE, without numbers left over."""
    await selected(client)
    assert await client.command(2010) == ACCEPTED
    status = await client.tracking(lambda m: m.tracking_status == 0)
    assert status.tracking_mode == 0
    assert math.isnan(status.rec_top_x)
    assert math.isnan(status.point_x)
    assert await client.command(2010) == ACCEPTED, "stopping where nothing is tracked"


async def bad_numbers_denied(client: Client) -> None:
    """NaN, infinity, outside 0 to 1 and inverted or empty rectangles are DENIED, and change nothing."""
    await stop(client)
    for number, params in (
        (2005, (NAN, 0.1, 0.2, 0.2)),
        (2005, (0.1, 0.1, INF, 0.2)),
        (2005, (-0.1, 0.1, 0.2, 0.2)),
        (2005, (0.1, 0.1, 1.2, 0.2)),
        (2005, (0.6, 0.1, 0.4, 0.2)),
        (2005, (0.1, 0.4, 0.4, 0.2)),
        (2005, (0.3, 0.3, 0.3, 0.3)),
        (2004, (NAN, 0.5, 0.1)),
        (2004, (0.5, -INF, 0.1)),
        (2004, (0.5, 1.5, 0.1)),
        (2004, (0.5, 0.5, -0.1)),
        (2004, (0.5, 0.5, 1.1)),
        (511, (275.25, 1e5)),
        (511, (275, NAN)),
        (511, (275, -INF)),
        (511, (275, INF)),
        (511, (275, -7)),
        (511, (44444, 1e5)),
        (512, (44444,)),
        (512, (INF,)),
    ):
        result = await client.command(number, *params)
        assert result == DENIED, f"command {number} {params}: {RESULTS[result]}"
    await client.command(511, 275, 50_000)
    assert (await client.tracking(lambda m: True)).tracking_status == 0


async def other_targets_ignored(client: Client) -> None:
    """Commands to another system or component get no answer from the camera; those to all of them do."""
    assert client.camera is not None
    system, component = client.camera
    since = len(client.heard)
    for to in ((system % 250 + 1, component), (system, 193)):
        client.send(client.long(512, 259, to=to))
    client.send(client.long(521, 1, to=(system, 0)))
    await client.wait("CAMERA_INFORMATION", since=since)
    client.send(client.long(400, 1, to=(system, 0)))  # arming is none of the camera's business
    await client.command(521, 1)
    acks = [m for m in client.heard[since:] if m.get_type() == "COMMAND_ACK" and _of(client)(m)]
    assert [m.command for m in acks] == [521, 521]


async def unknown_unsupported(client: Client) -> None:
    """A command that is none of a camera's is UNSUPPORTED."""
    for number in (400, 31_000, 60_000):
        assert await client.command(number) == UNSUPPORTED


async def command_int(client: Client) -> None:
    """COMMAND_INT is understood as COMMAND_LONG is."""
    assert client.camera is not None
    since = len(client.heard)
    client.send(mavlink.MAVLink_command_int_message(*client.camera, 0, 512, 0, 0, 259.0, 0, 0, 0, 0, 0, 0.0))
    assert await client.acknowledged(512, since) == ACCEPTED
    since = len(client.heard)
    client.send(mavlink.MAVLink_command_int_message(*client.camera, 0, 2005, 0, 0, *BOX, 0, 0, 0.0))
    assert await client.acknowledged(2005, since) == ACCEPTED
    await stop(client)


async def repeated_command_once(client: Client) -> None:
    """The same command sent twice is acknowledged each time."""
    since = len(client.heard)
    for confirmation in (0, 1):
        client.send(client.long(2005, *BOX, confirmation=confirmation))
    for _ in range(2):
        ack = await client.wait("COMMAND_ACK", lambda m: m.command == 2005, since)
        assert ack.result == ACCEPTED
        since = client.heard.index(ack) + 1
        client.send(client.long(2005, *BOX, confirmation=2))
    await stop(client)


async def interval_off(client: Client) -> None:
    """-1 ends the status; 512 still gets one."""
    assert await client.command(511, 275, 20_000) == ACCEPTED
    await client.tracking(lambda m: True)
    assert await client.command(511, 275, -1) == ACCEPTED
    since = len(client.heard)
    await client.asked(521, "CAMERA_INFORMATION", 1)
    await asyncio.sleep(0.15)
    assert not [m for m in client.heard[since:] if m.get_type() == "CAMERA_TRACKING_IMAGE_STATUS"]
    await client.request(275, "CAMERA_TRACKING_IMAGE_STATUS")


async def interval_rates(client: Client) -> None:
    """500,000 us and 0 give about 2 Hz; 1 us no more than 100 Hz."""
    for period_us, low_hz, high_hz in ((500_000, 1.3, 2.7), (0, 1.3, 2.7), (1, 10.0, 100.0)):
        assert await client.command(511, 275, period_us) == ACCEPTED
        await client.tracking(lambda m: True)
        since, begun_s = len(client.heard), time.monotonic()
        await asyncio.sleep(3.0)
        took_s = time.monotonic() - begun_s
        count = sum(m.get_type() == "CAMERA_TRACKING_IMAGE_STATUS" for m in client.heard[since:])
        assert low_hz < count / took_s < high_hz, f"{period_us} us: {count / took_s:.1f} Hz"
    await client.command(511, 275, -1)


async def parameters(client: Client) -> None:
    """PARAM_EXT: a list without gaps, each readable by name and index, in the bytes of its type."""
    assert client.camera is not None
    found = await read_parameters(client)
    if not found:
        raise NotApplicableError("no parameters")
    for index, value in enumerate(found):
        for name, at in ((value.param_id, -1), ("", index)):
            since = len(client.heard)
            client.send(mavlink.MAVLink_param_ext_request_read_message(*client.camera, name.encode(), at))
            read = await client.wait("PARAM_EXT_VALUE", since=since)
            assert (read.param_id, read.param_type) == (value.param_id, value.param_type)


async def parameter_set(client: Client) -> None:
    """PARAM_EXT_SET to its own value is acknowledged with it; an unknown name and a wrong type are not accepted."""
    assert client.camera is not None
    listed = await read_parameters(client)
    if not listed:
        raise NotApplicableError("no parameters")
    value = listed[0]
    ack = await set_parameter(client, value.param_id, value_bytes(value), value.param_type)
    assert ack.param_result == 0
    assert value_bytes(ack) == value_bytes(value)
    assert ack._param_value_raw == value._param_value_raw
    assert (await set_parameter(client, "NO_SUCH_ONE", b"\1", 1)).param_result != 0
    assert (await set_parameter(client, value.param_id, struct.pack("<d", 1.0), 10)).param_result != 0


async def geo_status(client: Client) -> None:
    """CAMERA_TRACKING_GEO_STATUS if the flag says so; denied if not."""
    info = await client.request(259, "CAMERA_INFORMATION")
    if not info.flags & GEO:
        assert await client.command(512, 276) == DENIED
        raise NotApplicableError("does not know where the target is")
    await client.request(276, "CAMERA_TRACKING_GEO_STATUS")


async def film(client: Client) -> None:
    """2500 and 2501 begin and end a film, and CAMERA_CAPTURE_STATUS says so; if the flag says so."""
    info = await client.request(259, "CAMERA_INFORMATION")
    if not info.flags & VIDEO:
        assert await client.command(2500) != ACCEPTED
        raise NotApplicableError("makes no films")
    before = (await client.request(262, "CAMERA_CAPTURE_STATUS")).video_status
    for wanted in (0, 1, 0, before):
        assert await client.command(2500 if wanted else 2501) == ACCEPTED
        assert (await client.request(262, "CAMERA_CAPTURE_STATUS")).video_status == wanted


async def garbage_survived(client: Client) -> None:
    """Random bytes and damaged frames change nothing."""
    good = client.long(512, 259).pack(client.mav)
    for size in (1, 7, 60, 300, 1400):
        client.send_bytes(bytes(range(256)) * 6 if size == 1400 else bytes([0xFD, 0xFF]) * (size // 2))
        client.send_bytes(bytes([good[0] ^ size & 1, *good[1:-1], good[-1] ^ 0xFF]))
    since = len(client.heard)
    client.send_bytes(b"\xfd\xff\x00" + good)
    await client.wait("CAMERA_INFORMATION", since=since)


Check = Callable[[Client], Awaitable[None]]
CHECKS: tuple[Check, ...] = (
    information_by_521_and_512, settings_storage_capture, field_of_view, video_stream, camera_mode, track_rectangle,
    track_point, stop_tracking, bad_numbers_denied, other_targets_ignored, unknown_unsupported, command_int,
    repeated_command_once, interval_off, parameters, parameter_set, geo_status, film, garbage_survived,
)  # fmt: skip
SLOW_CHECKS: tuple[Check, ...] = (heartbeat_once_a_second, interval_rates)


def _of(client: Client) -> Callable[[Any], bool]:
    return lambda message: (message.get_srcSystem(), message.get_srcComponent()) == client.camera

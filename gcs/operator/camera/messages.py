"""The messages of a camera, out of plain facts; unknown numbers are NaN, as the MAVLink definitions ask for."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from enum import IntEnum, IntFlag
from importlib.metadata import PackageNotFoundError, version
from typing import Final
from urllib.parse import urlsplit

from gcs.framing import Message, dialect
from gcs.operator.camera.setup import CameraSetup, TargetPlace

_NAN: Final = math.nan
_UNKNOWN: Final = 2**31 - 1  # of degrees and millimetres
_VENDOR, _MODEL = "ClimRT", "Tracking camera"
_STREAM_ID: Final = 1
_TEXT_CHARS, _MAX_CHUNKS = 50, 5
_WARNING: Final = 4  # MAV_SEVERITY
# MAV_TYPE_CAMERA, MAV_AUTOPILOT_INVALID, MAV_STATE_ACTIVE, MAVLink 2
_HEARTBEAT: Final = (30, 8, 0, 0, 4, 3)
VIDEO_MODE: Final = 1  # CAMERA_MODE

HEARTBEAT: Final = 0
INFORMATION, SETTINGS, STORAGE, CAPTURE = 259, 260, 261, 262
STREAM, STREAM_STATUS, FOV = 269, 270, 271
IMAGE_STATUS, GEO_STATUS = 275, 276


class Result(IntEnum):
    """MAV_RESULT, as far as it is used."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


class Flag(IntFlag):
    """CAMERA_CAP_FLAGS, as far as they are used."""

    CAPTURE_VIDEO = 1
    HAS_VIDEO_STREAM = 256
    HAS_TRACKING_POINT = 512
    HAS_TRACKING_RECTANGLE = 1024
    HAS_TRACKING_GEO_STATUS = 2048


class Tracking(IntFlag):
    """CAMERA_TRACKING_STATUS_FLAGS, as far as they are used."""

    IDLE = 0
    ACTIVE = 1
    ERROR = 2
    COASTING = 8


Corners = tuple[float, float, float, float]  # left, top, right, bottom as fractions of the picture


def heartbeat() -> Message:
    """A camera is there."""
    return dialect.MAVLink_heartbeat_message(*_HEARTBEAT)


def ack(command: int, result: int, system_id: int, component_id: int) -> Message:
    """COMMAND_ACK to who asked."""
    return dialect.MAVLink_command_ack_message(command, result, 0, 0, system_id, component_id)


def information(setup: CameraSetup, time_ms: int, size_px: tuple[int, int], flags: Flag) -> Message:
    """CAMERA_INFORMATION (259)."""
    return dialect.MAVLink_camera_information_message(
        time_ms, _fixed(_VENDOR), _fixed(_MODEL), _firmware_version(), _NAN, _NAN, _NAN, *size_px, 0, int(flags),
        setup.definition_version, (setup.definition_url or "").encode()[:140], setup.gimbal_device_id,
    )  # fmt: skip


def settings(time_ms: int) -> Message:
    """CAMERA_SETTINGS (260): it films, and can do nothing else."""
    return dialect.MAVLink_camera_settings_message(time_ms, VIDEO_MODE, _NAN, _NAN)


def storage(time_ms: int) -> Message:
    """STORAGE_INFORMATION (261): there is none that a client could see."""
    not_supported = 3
    return dialect.MAVLink_storage_information_message(time_ms, 1, 0, not_supported, 0.0, 0.0, 0.0, _NAN, _NAN)


def capture_status(time_ms: int, filming: bool, filming_ms: int) -> Message:
    """CAMERA_CAPTURE_STATUS (262)."""
    return dialect.MAVLink_camera_capture_status_message(time_ms, 0, int(filming), 0.0, filming_ms, 0.0)


def stream_information(setup: CameraSetup, size_px: tuple[int, int], fps: float, hfov_rad: float) -> Message:
    """VIDEO_STREAM_INFORMATION (269) of the one stream there is."""
    kind, uri = _stream_address(setup.stream_url or "")
    running, h264 = 1, 1
    return dialect.MAVLink_video_stream_information_message(
        _STREAM_ID, 1, kind, running, fps, *size_px, setup.bitrate_kbps * 1000, 0, round(math.degrees(hfov_rad)),
        b"Tracking", uri.encode()[:160], h264,
    )  # fmt: skip


def stream_status(setup: CameraSetup, size_px: tuple[int, int], fps: float, hfov_rad: float) -> Message:
    """VIDEO_STREAM_STATUS (270)."""
    hfov_deg = round(math.degrees(hfov_rad))
    return dialect.MAVLink_video_stream_status_message(
        _STREAM_ID, 1, fps, *size_px, setup.bitrate_kbps * 1000, 0, hfov_deg
    )


def fov_status(time_ms: int, size_px: tuple[int, int], hfov_rad: float) -> Message:
    """CAMERA_FOV_STATUS (271): the angles only; where the camera is and looks, the vehicle says."""
    vfov_rad = 2 * math.atan(math.tan(hfov_rad / 2) * size_px[1] / size_px[0])
    return dialect.MAVLink_camera_fov_status_message(
        time_ms, *[_UNKNOWN] * 6, [_NAN] * 4, math.degrees(hfov_rad), math.degrees(vfov_rad)
    )


def image_status(tracking: Tracking, corners: Corners | None, rendered: bool) -> Message:
    """CAMERA_TRACKING_IMAGE_STATUS (275): a rectangle, or mode NONE without one."""
    none, rectangle, is_rendered, in_status = 0, 2, 2, 4
    mode, data = (none, none) if corners is None else (rectangle, in_status | (is_rendered if rendered else 0))
    return dialect.MAVLink_camera_tracking_image_status_message(
        int(tracking), mode, data, _NAN, _NAN, _NAN, *(corners or [_NAN] * 4)
    )


def geo_status(tracking: Tracking, place: TargetPlace | None) -> Message:
    """CAMERA_TRACKING_GEO_STATUS (276); IDLE where the place is not known."""
    if place is None:
        unknown = [_NAN] * 10
        idle = int(Tracking.IDLE) if tracking != Tracking.ERROR else int(tracking)
        return dialect.MAVLink_camera_tracking_geo_status_message(idle, _UNKNOWN, _UNKNOWN, *unknown)
    velocity = place.velocity_ned_mps or (_NAN, _NAN, _NAN)
    return dialect.MAVLink_camera_tracking_geo_status_message(
        int(tracking), round(place.latitude_deg * 1e7), round(place.longitude_deg * 1e7), place.altitude_m, _NAN, _NAN,
        *velocity, _NAN, _NAN if place.distance_m is None else place.distance_m, _NAN, _NAN,
    )  # fmt: skip


def interval(message_id: int, period_s: float | None) -> Message:
    """MESSAGE_INTERVAL (244); None: it is not sent."""
    return dialect.MAVLink_message_interval_message(message_id, -1 if period_s is None else round(period_s * 1e6))


def texts(text: str, number: int) -> Iterator[Message]:
    """STATUSTEXT, in chunks of 50 characters where it is longer; number: 1 to 65535, tells long texts apart."""
    data = text.encode("ascii", "replace")[: _TEXT_CHARS * _MAX_CHUNKS - 1]
    if len(data) <= _TEXT_CHARS:
        yield dialect.MAVLink_statustext_message(_WARNING, data)
        return
    # A chunk that is not full says that it is the last one; of a whole number of chunks an empty one does.
    for chunk, at in enumerate(range(0, len(data) + 1, _TEXT_CHARS)):
        yield dialect.MAVLink_statustext_message(_WARNING, data[at : at + _TEXT_CHARS], number, chunk)


def _stream_address(url: str) -> tuple[int, str]:
    """VIDEO_STREAM_TYPE, and what stands for the address: RTP's is the port that the client listens on."""
    rtsp, rtp, mpeg_ts = 0, 1, 3
    parts = urlsplit(url)
    if parts.scheme in ("rtp", "udp"):
        return (rtp if parts.scheme == "rtp" else mpeg_ts), str(parts.port or "")
    return rtsp, url


def _fixed(name: str) -> list[int]:
    return list(name.encode()[:32].ljust(32, b"\0"))


@functools.cache  # it is read from files
def _firmware_version() -> int:
    """Major in the lowest byte, then minor and patch, as the message's definition has it."""
    try:
        numbers = version("climrt-gcs").split(".")[:3]
    except PackageNotFoundError:
        return 0
    return sum((int(number) & 0xFF) << 8 * at for at, number in enumerate(numbers) if number.isdecimal())

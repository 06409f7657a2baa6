"""What a MAVLink camera is told at its start, and what it may be told of the target's place."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

from control.types import Vec3
from gcs.config import Config
from gcs.errors import WireError

COMPONENT_IDS: Final[range] = range(100, 106)  # MAV_COMP_ID_CAMERA .. CAMERA6
DEFAULT_STANDOFF_M: Final = (3.0, 80.0)


@dataclass(frozen=True, slots=True)
class CameraSetup:
    """What does not change while the camera is there.

    system_id: the vehicle's. display_delay_s: how old the picture is that its user clicks on. may_follow: following
    may be begun and ended by the parameter FOLLOW. stream_url: where the video can be had, rtsp://HOST:PORT/PATH or
    rtp://HOST:PORT (sent there); None: nowhere. rendered: the box is drawn into that video. definition_url: of the
    camera definition, definition_version: of its content. standoff_m: what may be asked for. abandoned_s: unheard for
    so long, the clients have left a follow that one of them began; None: never.
    """

    system_id: int
    component_id: int = COMPONENT_IDS[0]
    display_delay_s: float = 0.3
    may_follow: bool = False
    stream_url: str | None = None
    rendered: bool = False
    bitrate_kbps: int = 0
    definition_url: str | None = None
    definition_version: int = 0
    standoff_m: tuple[float, float] = DEFAULT_STANDOFF_M
    gimbal_device_id: int = 0
    abandoned_s: float | None = None


@dataclass(frozen=True, slots=True)
class TargetPlace:
    """Where the target is: degrees, metres above mean sea level; None = not known."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    velocity_ned_mps: Vec3 | None = None
    distance_m: float | None = None


def free_component_id(wanted: int, taken: Collection[int]) -> int:
    """The one wanted, or the next that no other camera of the vehicle has. WireError if all six are taken."""
    least, count = COMPONENT_IDS[0], len(COMPONENT_IDS)
    for step in range(count):
        component_id: int = least + (wanted - least + step) % count
        if component_id not in taken:
            return component_id
    raise WireError("MAVLink camera: the vehicle already has cameras 100 to 105")


def camera_setup(config: Config, system_id: int = 1, heard: Collection[int] = ()) -> CameraSetup:
    """As configured, on this vehicle; the camera and its definition are both made of it.

    heard: component ids of cameras that it already has. WireError if it is full.
    """
    wanted, follow = config.mavlink_camera, config.control.follow
    return CameraSetup(
        system_id=system_id,
        component_id=free_component_id(wanted.component_id, heard),
        display_delay_s=wanted.display_delay_s,
        may_follow=wanted.may_follow,
        standoff_m=(follow.min_distance_m, follow.max_distance_m),
        abandoned_s=config.page.abandoned_s,
    )

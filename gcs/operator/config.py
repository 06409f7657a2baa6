"""Settings of what an operator sees and steers by: the page, the MAVLink camera, the video that goes out."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

_HOST_PORT = re.compile(r"[\w.:\[\]-]+:\d{1,5}")


def _port(default: int | None) -> int:
    return field(default=default, metadata={"low": 0, "high": 65535})  # type: ignore[return-value]


@dataclass(frozen=True, slots=True)
class PageConfig:
    """The operator's page in a browser. host: 127.0.0.1 is seen on this machine alone, 0.0.0.0 by the whole network.

    port: 0 takes a free one. token: what a browser must show once; null makes a new one at each start. Given here,
    it is as secret as this file. names: under which the page may be asked for beside localhost and its addresses, as
    [gcs.local]. abandoned_s: a follow that was confirmed here is aborted when nothing has been heard from any page for
    so long, one that was confirmed by the MAVLink camera when nothing has been from its clients; null: never.
    """

    enabled: bool = True
    host: str = "127.0.0.1"
    port: int = _port(8870)
    token: str | None = None
    names: tuple[str, ...] = ()
    abandoned_s: float | None = field(default=10.0, metadata={"low": 2.0, "high": 120.0})
    most_viewers: int = field(default=16, metadata={"low": 1, "high": 100})
    jpeg_quality: int = field(default=75, metadata={"low": 20, "high": 95})
    most_width_px: int = field(default=1280, metadata={"low": 160, "high": 4096})

    def __post_init__(self) -> None:
        if self.token is not None and len(self.token) < 12:
            raise ValueError("token must have 12 characters or more")


@dataclass(frozen=True, slots=True)
class MavlinkCameraConfig:
    """A MAVLink camera that tracks, for QGroundControl and others: they draw the box, and see it.

    url: where they are, as udpout://127.0.0.1:14550, or udpin://0.0.0.0:14560 to be asked; null: there is none. It
    speaks as component_id of the vehicle's own system. display_delay_s: how old the picture is that its user clicks
    on. may_follow: following may be started and ended by its parameters too; without it only a box can be drawn.
    """

    url: str | None = None
    component_id: int = field(default=100, metadata={"low": 100, "high": 105})
    display_delay_s: float = field(default=0.3, metadata={"low": 0.0, "high": 2.0})
    may_follow: bool = False


@dataclass(frozen=True, slots=True)
class VideoOutConfig:
    """H.264 for other programs (needs the extra `video`). rtsp_port: served at rtsp://HOST:PORT/live; null: not.

    rtp: also sent there without being asked, as 127.0.0.1:5600. annotated: with box and state drawn in. host: where
    RTSP listens.
    """

    rtsp_port: int | None = _port(None)
    host: str = "127.0.0.1"
    rtp: str | None = None
    annotated: bool = True
    bitrate_kbps: int = field(default=2500, metadata={"low": 100, "high": 50_000})

    def __post_init__(self) -> None:
        if self.rtp is not None and not _HOST_PORT.fullmatch(self.rtp):
            raise ValueError(f"rtp {self.rtp!r} must be HOST:PORT")

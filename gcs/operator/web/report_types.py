"""What browsers are told: JSON texts on the WebSocket, and pictures as binary. What they say is in `protocol`."""

from __future__ import annotations

import struct
from typing import Final, TypeAlias

import msgspec

Point: TypeAlias = tuple[float, float]

_ENCODER: Final = msgspec.json.Encoder()


class Report(msgspec.Struct, frozen=True, kw_only=True, tag_field="type"):
    """To browsers."""

    def encode(self) -> bytes:
        """As JSON; what is not finite becomes null."""
        return _ENCODER.encode(self)


class Starting(Report, frozen=True, tag="starting"):
    """There is no station yet, and what is waited for."""

    text: str


class Welcome(Report, frozen=True, tag="welcome"):
    """There is a station; viewer: the name of who is told this; replay: it is a recording."""

    viewer: str
    size: tuple[int, int]
    watermark: str | None
    webrtc: bool
    version: str
    replay: bool


class FrameReport(Report, frozen=True, tag="frame"):
    """One frame through the tracker; boxes in px of the full picture."""

    frame: int
    t_s: float
    box: tuple[float, ...] | None
    visible: bool
    predicted: tuple[float, ...] | None
    confidence: float | None
    selection: int


class VehicleReport(msgspec.Struct, frozen=True, kw_only=True):
    """Part of `StatusReport`."""

    mode: str
    armed: bool
    in_air: bool
    height_m: float | None
    speed_mps: float | None
    battery_frac: float | None
    yaw_rad: float | None


class StatusReport(Report, frozen=True, tag="status"):
    """Everything beside the picture; None = not known."""

    t_s: float
    state: str
    engaging: bool
    tone: str
    headline: str
    reasons: tuple[str, ...]
    refusals: tuple[str, ...]
    confidence: float | None
    distance_m: float | None
    standoff_m: float | None
    mode: str
    limits: tuple[str, ...]
    latency: dict[str, float] | None
    fps: float
    vehicle: VehicleReport
    ages_s: dict[str, float | None]
    link: str
    warnings: tuple[str, ...]
    controller: str
    in_control: bool
    viewers: int
    recording: bool | None
    selection: int


class FenceReport(msgspec.Struct, frozen=True, kw_only=True):
    """Part of `MapReport`; metres north and east of home."""

    north_m: float
    east_m: float
    radius_m: float
    polygon_m: tuple[Point, ...]
    operator_m: Point
    operator_distance_m: float | None


class MapReport(Report, frozen=True, tag="map"):
    """Seen from above, metres north and east of home."""

    vehicle_m: Point | None
    yaw_rad: float
    target_m: Point | None
    fence: FenceReport | None
    vehicle_path_m: tuple[Point, ...]
    target_path_m: tuple[Point, ...]


class CandidateReport(msgspec.Struct, frozen=True):
    """Part of `CandidatesReport`."""

    number: int
    box: tuple[float, ...]


class CandidatesReport(Report, frozen=True, tag="candidates"):
    """What could be selected by its number."""

    boxes: list[CandidateReport]


class SayReport(Report, frozen=True, tag="say"):
    """A line for the list of messages."""

    text: str
    t_s: float


class AnswerReport(Report, frozen=True, tag="answer"):
    """To the message of this id."""

    id: int | None
    ok: bool
    text: str
    reasons: tuple[str, ...] = ()


class StretchReport(msgspec.Struct, frozen=True):
    """Part of `TimelineReport`."""

    begin_s: float
    end_s: float
    state: str


class EventReport(msgspec.Struct, frozen=True):
    """Part of `TimelineReport`."""

    t_s: float
    kind: str
    text: str


class TimelineReport(Report, frozen=True, tag="timeline"):
    """Of a recording: what there is to see, in seconds since its beginning."""

    span_s: float
    stretches: list[StretchReport]
    events: list[EventReport]


class PlayheadReport(Report, frozen=True, tag="playhead"):
    """Of a recording: where it stands."""

    t_s: float
    playing: bool
    ended: bool
    speed: float
    frame: int | None
    unix_s: float | None


_PICTURE: Final = struct.Struct("<4I")


def picture_head(seq: int, width_px: int, height_px: int) -> bytes:
    """What stands before a JPEG: the frame's number and the size of the full picture, four little-endian uint32."""
    return _PICTURE.pack(seq & 0xFFFFFFFF, width_px, height_px, 0)


PICTURE_HEAD_BYTES: Final = _PICTURE.size

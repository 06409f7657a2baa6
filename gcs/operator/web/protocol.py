"""The messages between page and browser, as they stand on the WebSocket (JSON texts, and pictures as binary)."""

from __future__ import annotations

import struct
from typing import Annotated, Final, TypeAlias

import msgspec

MOST_BYTES: Final = 16 * 1024  # of one message of a client

_Count: TypeAlias = Annotated[int, msgspec.Meta(ge=0, le=2**53)]
_Number: TypeAlias = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]
_Name: TypeAlias = Annotated[str, msgspec.Meta(max_length=40)]
XYWH: TypeAlias = tuple[_Number, _Number, _Number, _Number]
Point: TypeAlias = tuple[float, float]


class ProtocolError(ValueError):
    """A message that no page of ours sends."""


class Message(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="do"):
    """From a browser; what carries an id is answered."""

    id: _Count | None = None


class Take(Message, frozen=True, tag="take"):
    """Be the one in control."""

    force: bool = False


class Release(Message, frozen=True, tag="release"):
    """Let somebody else be in control."""


class Select(Message, frozen=True, tag="select"):
    """A box (px of the full picture) that was drawn on this frame."""

    box: XYWH
    frame: _Count


class PointAt(Message, frozen=True, tag="point"):
    """A point (px) of this frame."""

    x: _Number
    y: _Number
    frame: _Count


class Candidate(Message, frozen=True, tag="candidate"):
    """The candidate of this number."""

    number: _Count


class Candidates(Message, frozen=True, tag="candidates"):
    """Whether candidates shall be looked for and told."""

    on: bool = True


class Deselect(Message, frozen=True, tag="deselect"):
    """Track nothing."""


class HoldBegin(Message, frozen=True, tag="hold_begin"):
    """The button or key of confirmation was pressed."""


class HoldEnd(Message, frozen=True, tag="hold_end"):
    """It was let go before its time."""


class Confirm(Message, frozen=True, tag="confirm"):
    """It was held long enough: follow."""


class Abort(Message, frozen=True, tag="abort"):
    """Stop; anybody may."""


class Ack(Message, frozen=True, tag="ack"):
    """Seen that following has ended."""


class Mode(Message, frozen=True, tag="mode"):
    """The follow mode by its name."""

    mode: _Name


class Standoff(Message, frozen=True, tag="standoff"):
    """Metres over the ground; null: as it is."""

    m: _Number | None = None


class Step(Message, frozen=True, tag="step"):
    """More metres, or fewer."""

    m: _Number


class Distance(Message, frozen=True, tag="distance"):
    """How far the target is (m); null: to be found from height and angle."""

    m: _Number | None = None


class Hold(Message, frozen=True, tag="hold"):
    """The vehicle's hold mode."""


class Takeoff(Message, frozen=True, tag="takeoff"):
    """Arm and climb."""

    height_m: _Number | None = None


class Land(Message, frozen=True, tag="land"):
    """Land here."""


class Return(Message, frozen=True, tag="return"):
    """Fly home."""


class Record(Message, frozen=True, tag="record"):
    """Film, or not; null: the other way round."""

    on: bool | None = None


class Accept(Message, frozen=True, tag="accept"):
    """Take a parameter as it is."""

    name: _Name


class Ping(Message, frozen=True, tag="ping"):
    """Still here."""


class Seen(Message, frozen=True, tag="seen"):
    """This picture has been shown: there is room for another."""

    frame: _Count


class Pictures(Message, frozen=True, tag="pictures"):
    """Whether pictures shall be sent."""

    on: bool = True


Asked: TypeAlias = (
    Take | Release | Select | PointAt | Candidate | Candidates | Deselect | HoldBegin | HoldEnd | Confirm | Abort | Ack
    | Mode | Standoff | Step | Distance | Hold | Takeoff | Land | Return | Record | Accept | Ping | Seen | Pictures
)  # fmt: skip

_DECODER: Final = msgspec.json.Decoder(Asked)
_ENCODER: Final = msgspec.json.Encoder()


def decode(text: str | bytes) -> Asked:
    """What a browser asks; ProtocolError says what is wrong with it, in one line."""
    try:
        asked: Asked = _DECODER.decode(text)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise ProtocolError(str(error)) from None
    return asked


class Report(msgspec.Struct, frozen=True, kw_only=True, tag_field="type"):
    """To browsers."""

    def encode(self) -> bytes:
        """As JSON; what is not finite becomes null."""
        return _ENCODER.encode(self)


class Starting(Report, frozen=True, tag="starting"):
    """There is no station yet, and what is waited for."""

    text: str


class Welcome(Report, frozen=True, tag="welcome"):
    """There is a station; viewer: the name of who is told this."""

    viewer: str
    size: tuple[int, int]
    watermark: str | None
    webrtc: bool
    version: str


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


_PICTURE: Final = struct.Struct("<4I")


def picture_head(seq: int, width_px: int, height_px: int) -> bytes:
    """What stands before a JPEG: the frame's number and the size of the full picture, four little-endian uint32."""
    return _PICTURE.pack(seq & 0xFFFFFFFF, width_px, height_px, 0)


PICTURE_HEAD_BYTES: Final = _PICTURE.size

"""What browsers say to the page: JSON texts on the WebSocket. What they are told is in `report_types`."""

from __future__ import annotations

from typing import Annotated, Final, TypeAlias

import msgspec

MOST_BYTES: Final = 16 * 1024  # of one message of a client

_Count: TypeAlias = Annotated[int, msgspec.Meta(ge=0, le=2**53)]
_Number: TypeAlias = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]
_Name: TypeAlias = Annotated[str, msgspec.Meta(max_length=40)]
XYWH: TypeAlias = tuple[_Number, _Number, _Number, _Number]


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


class Play(Message, frozen=True, tag="play"):
    """Of a recording: go on, or stand still; null: the other way round."""

    on: bool | None = None


class Seek(Message, frozen=True, tag="seek"):
    """Of a recording: seconds since its beginning."""

    t_s: _Number


class Speed(Message, frozen=True, tag="speed"):
    """Of a recording: times as fast as it was."""

    times: _Number


class Frames(Message, frozen=True, tag="frames"):
    """Of a recording: so many pictures on, or back."""

    by: Annotated[int, msgspec.Meta(ge=-1000, le=1000)]


Asked: TypeAlias = (
    Take | Release | Select | PointAt | Candidate | Candidates | Deselect | HoldBegin | HoldEnd | Confirm | Abort | Ack
    | Mode | Standoff | Step | Distance | Hold | Takeoff | Land | Return | Record | Accept | Ping | Seen | Pictures
    | Play | Seek | Speed | Frames
)  # fmt: skip

_DECODER: Final = msgspec.json.Decoder(Asked)


def decode(text: str | bytes) -> Asked:
    """What a browser asks; ProtocolError says what is wrong with it, in one line."""
    try:
        asked: Asked = _DECODER.decode(text)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise ProtocolError(str(error)) from None
    return asked

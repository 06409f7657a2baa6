"""Everything an operator can ask of a flight, and the words for it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, TypeAlias

from control.modes import FollowMode
from gcs.video import Frame
from tracker.box import Box

_MODES: Final = tuple(mode.value for mode in FollowMode)
_STEP_M: Final = "2"  # of an approach or retreat that says no more


class OrderError(ValueError):
    """A line that is no order; says what was expected."""


@dataclass(frozen=True, slots=True)
class Select:
    """Track what is in the box (px); frame: the picture it was drawn on, None for the newest. Moves nothing."""

    box: Box
    frame: Frame | None = None


@dataclass(frozen=True, slots=True)
class SelectPoint:
    """Track what stands at this point (px) of the picture that was pointed at; moves nothing.

    radius_px: about how large it is, None where that is not known.
    """

    x_px: float
    y_px: float
    frame: Frame | None = None
    radius_px: float | None = None


@dataclass(frozen=True, slots=True)
class SelectCandidate:
    """Track the candidate of this number (see gcs.candidates); moves nothing."""

    number: int


@dataclass(frozen=True, slots=True)
class Deselect:
    """Track nothing."""


@dataclass(frozen=True, slots=True)
class Confirm:
    """Follow what is tracked; the one deliberate act that lets the vehicle move."""


@dataclass(frozen=True, slots=True)
class Acknowledge:
    """Seen that following has ended by itself, or that the pilot took over."""


@dataclass(frozen=True, slots=True)
class Abort:
    """Zero velocity at once, then the vehicle's hold mode."""


@dataclass(frozen=True, slots=True)
class Hold:
    """The vehicle's hold mode, following or not."""


@dataclass(frozen=True, slots=True)
class TakeOff:
    """Arm and climb; None takes the configured height above home (m)."""

    height_m: float | None = None


@dataclass(frozen=True, slots=True)
class Land:
    """Land here."""


@dataclass(frozen=True, slots=True)
class Return:
    """Fly home and land there."""


@dataclass(frozen=True, slots=True)
class SetMode:
    """What the next confirmation asks for, and a follow that is under way takes up."""

    mode: FollowMode


@dataclass(frozen=True, slots=True)
class SetStandoff:
    """Ground distance (m) for the next confirmation, and for a follow that is under way.

    None keeps the one at that moment.
    """

    standoff_m: float | None


@dataclass(frozen=True, slots=True)
class StepStandoff:
    """While following: hold so much (m) more distance than now; less where it is negative."""

    by_m: float


@dataclass(frozen=True, slots=True)
class SetDistance:
    """Ground distance (m) now, as the operator sees it; None lets height and view angle tell."""

    distance_m: float | None


@dataclass(frozen=True, slots=True)
class Accept:
    """Take this parameter of the vehicle as it is, although the audit calls it unsafe."""

    name: str


@dataclass(frozen=True, slots=True)
class Record:
    """Film what is seen, or no longer; None: the other way round than now. The log is kept in any case."""

    on: bool | None = None


@dataclass(frozen=True, slots=True)
class Quit:
    """Stop, hold and leave."""


Order: TypeAlias = (
    Select
    | SelectPoint
    | SelectCandidate
    | Deselect
    | Confirm
    | Acknowledge
    | Abort
    | Hold
    | TakeOff
    | Land
    | Return
    | SetMode
    | SetStandoff
    | StepStandoff
    | SetDistance
    | Accept
    | Record
    | Quit
)

HELP = (
    "box X Y W H · point X Y · pick NUMBER · drop · follow · abort · ack · mode MODE · standoff M|now · approach [M] · "
    "retreat [M] · distance M|auto · hold · takeoff [M] · land · rtl · accept PARAMETER · record [on|off] · quit"
)


def parse_order(line: str) -> Order:
    """The order of one line; OrderError says what is wrong with it."""
    words = line.lower().split()
    if not words:
        raise OrderError(f"nothing said; {HELP}")
    name, args = words[0], words[1:]
    if name not in _ORDERS:
        raise OrderError(f"{name!r} is not known; {HELP}")
    form, make = _ORDERS[name]
    try:
        return make(*args)
    except (TypeError, ValueError, KeyError):
        raise OrderError(f"{line.strip()!r}: expected {form}") from None


def _box(x: str, y: str, w: str, h: str) -> Select:
    box = Box.from_xywh(*map(float, (x, y, w, h)))
    if not box.is_valid:
        raise ValueError(box)
    return Select(box)


def words_of(order: Order) -> str:
    """The order as `parse_order` takes it."""
    match order:
        case Select(box):
            return line_of(box)
        case SelectPoint(x_px, y_px):
            return f"point {x_px:.1f} {y_px:.1f}"
        case SelectCandidate(number):
            return f"pick {number}"
        case SetMode(mode):
            return f"mode {mode.value}"
        case SetStandoff(standoff_m):
            return f"standoff {'now' if standoff_m is None else f'{standoff_m:g}'}"
        case StepStandoff(by_m):
            return f"{'retreat' if by_m > 0 else 'approach'} {abs(by_m):g}"
        case SetDistance(distance_m):
            return f"distance {'auto' if distance_m is None else f'{distance_m:g}'}"
        case TakeOff(height_m):
            return "takeoff" if height_m is None else f"takeoff {height_m:g}"
        case Accept(name):
            return f"accept {name}"
        case Record(on):
            return "record" if on is None else f"record {'on' if on else 'off'}"
        case _:
            return _PLAIN[type(order)]


_PLAIN: Final[Mapping[type, str]] = MappingProxyType(
    {
        Deselect: "drop", Confirm: "follow", Acknowledge: "ack", Abort: "abort", Hold: "hold", Land: "land",
        Return: "rtl", Quit: "quit",
    }
)  # fmt: skip


def line_of(box: Box) -> str:
    """The box as the `box` order takes it."""
    return "box " + " ".join(f"{value:.1f}" for value in box.xywh)


def _positive_m(text: str) -> float:
    value = float(text)
    if not (math.isfinite(value) and value > 0):
        raise ValueError(text)
    return value


def _point(x: str, y: str) -> SelectPoint:
    x_px, y_px = float(x), float(y)
    if not (math.isfinite(x_px) and math.isfinite(y_px)):
        raise ValueError(x, y)
    return SelectPoint(x_px, y_px)


def _record(how: str | None = None) -> Record:
    return Record(None if how is None else {"on": True, "off": False}[how])


def _takeoff(height: str | None = None) -> TakeOff:
    return TakeOff(None if height is None else _positive_m(height))


def _standoff(text: str) -> SetStandoff:
    return SetStandoff(None if text == "now" else _positive_m(text))


def _distance(text: str) -> SetDistance:
    return SetDistance(None if text == "auto" else _positive_m(text))


_ORDERS: Mapping[str, tuple[str, Callable[..., Order]]] = MappingProxyType(
    {
        "box": ("box X Y W H in pixels, X and Y of the top-left corner", _box),
        "point": ("point X Y in pixels", _point),
        "pick": ("pick NUMBER of a candidate", lambda number: SelectCandidate(int(number))),
        "drop": ("drop", Deselect),
        "follow": ("follow", Confirm),
        "abort": ("abort", Abort),
        "ack": ("ack", Acknowledge),
        "hold": ("hold", Hold),
        "takeoff": ("takeoff [HEIGHT in metres above home]", _takeoff),
        "land": ("land", Land),
        "rtl": ("rtl", Return),
        "spotlight": ("spotlight", lambda: SetMode(FollowMode.SPOTLIGHT)),
        "mode": (f"mode {', '.join(_MODES[:-1])} or {_MODES[-1]}", lambda name: SetMode(FollowMode(name))),
        "approach": ("approach [METRES]", lambda by_m=_STEP_M: StepStandoff(-_positive_m(by_m))),
        "retreat": ("retreat [METRES]", lambda by_m=_STEP_M: StepStandoff(_positive_m(by_m))),
        "standoff": ("standoff METRES or standoff now", _standoff),
        "distance": ("distance METRES or distance auto", _distance),
        "accept": ("accept NAME of a parameter", lambda name: Accept(name.upper())),
        "record": ("record, record on or record off", _record),
        "quit": ("quit", Quit),
    }
)

"""How a recording is played at a page; a flight has nothing of it. Times are seconds since the recording began."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final, Protocol, TypeAlias, runtime_checkable

SPEEDS: Final = (0.1, 20.0)  # times as fast as it was


@dataclass(frozen=True, slots=True)
class Play:
    """Go on, or stand still; None: the other way round than now. At the end it begins anew."""

    on: bool | None = None


@dataclass(frozen=True, slots=True)
class Seek:
    """Go there, and go on as before."""

    t_s: float


@dataclass(frozen=True, slots=True)
class Speed:
    """Times as fast as it was, within `SPEEDS`."""

    times: float


@dataclass(frozen=True, slots=True)
class Frames:
    """So many pictures on, or back where negative, and stand still there."""

    by: int


PlaybackOrder: TypeAlias = Play | Seek | Speed | Frames


@dataclass(frozen=True, slots=True)
class Stretch:
    """A state from its begin to its end, as the banner named it."""

    begin_s: float
    end_s: float
    state: str


class Kind(Enum):
    """Of an event."""

    STATE = "state"
    ORDERED = "ordered"
    REFUSED = "refused"
    SAID = "said"


@dataclass(frozen=True, slots=True)
class Event:
    """Something to jump to."""

    t_s: float
    kind: Kind
    text: str


@dataclass(frozen=True, slots=True)
class Timeline:
    """What there is to see, in the order of time."""

    span_s: float
    stretches: tuple[Stretch, ...]
    events: tuple[Event, ...]


@dataclass(frozen=True, slots=True)
class Playhead:
    """Where it stands. frame: the number that the picture had then; unix_s: the time of day then, if known."""

    t_s: float
    is_playing: bool
    has_ended: bool
    speed: float
    frame: int | None
    unix_s: float | None


@runtime_checkable
class Playback(Protocol):
    """A `Station` that shows a recording. All on the event loop."""

    def timeline(self) -> Timeline:
        """All of it."""
        ...

    def playhead(self) -> Playhead:
        """Now."""
        ...

    def steer(self, order: PlaybackOrder) -> None:
        """Returns at once. ValueError where it cannot be done."""
        ...

"""The events of a flight's log. With those that come from outside, and the film, a flight can be flown again.

From outside come `Received`, `Selected`, `Ordered`, each frame's `Told` and each tick's time, acts and wishes; all
else follows from them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

from control.latency import DelayEstimate
from control.types import BearingMeasurement
from gcs.vision_tape import Told
from tracker.box import Box, TrackResult

_REFUSALS_S: Final = 1.0


class Journal(Protocol):
    """Where the parts of a flight note what came from outside. On the event loop; must not wait and must not raise."""

    def note(self, t_s: float, event: object, frame: int | None = None) -> None:
        """A frozen dataclass; t_s: when it happened (monotonic), frame: seq of the frame it is about."""
        ...


class NoJournal:
    """Of a flight that is not recorded."""

    def note(self, t_s: float, event: object, frame: int | None = None) -> None:
        """Nothing."""


@dataclass(frozen=True, slots=True)
class Begun:
    """The parts of the flight were put together; until now the link alone was open."""


@dataclass(frozen=True, slots=True)
class Received:
    """A MAVLink frame that was believed, as it came; base64 in the log."""

    data: bytes


@dataclass(frozen=True, slots=True)
class Selected:
    """The operator has drawn a box, or none. number: of the tracker's selections, 0 where it was not told.

    seen_on: the frame it was drawn on, None for the next one. target: the selection that control takes as its target
    from now on, 0 for none.
    """

    number: int
    box: Box | None
    seen_on: int | None
    target: int


@dataclass(frozen=True, slots=True)
class Expected:
    """The tracker asked where a hidden target should be in the frame captured then; box: the answer, px."""

    t_capture_s: float
    like: Box
    box: Box | None


@dataclass(frozen=True, slots=True)
class Ordered:
    """What an operator ordered, in the words of `parse_order`, and the answer; refused: it was not done."""

    order: str
    answer: str
    refused: bool = False


@dataclass(frozen=True, slots=True)
class Said:
    """A line for the operator."""

    text: str


@dataclass(frozen=True, slots=True)
class Refusals:
    """Everything that would keep a confirmation from being accepted, from now on; told where it changes."""

    reasons: tuple[str, ...]


class RefusalNotes:
    """Notes them where they have changed; asks once a second, and only for a flight that is recorded."""

    def __init__(self) -> None:
        self._reasons: tuple[str, ...] = ()
        self._due_s = 0.0

    def note(self, now_s: float, journal: Journal, refusals: Callable[[], tuple[str, ...]]) -> None:
        """At each tick."""
        if now_s < self._due_s or isinstance(journal, NoJournal):
            return
        self._due_s = now_s + _REFUSALS_S
        reasons = refusals()
        if reasons != self._reasons:
            self._reasons = reasons
            journal.note(now_s, Refusals(reasons))


@dataclass(frozen=True, slots=True)
class FrameRecord:
    """One frame: its times, what the tracker said of it and the line of sight that became of it.

    t_saw_s: when control was given it, None in a dry run. fingerprint: `gcs.video.frame.fingerprint` of the picture
    that was tracked. packet: number of the received packet that held it, see `gcs.recorder.film`; None where it is not
    known. told: None where the frame only passed by while the tracker caught up with a selection.
    """

    t_capture_s: float
    t_arrival_s: float
    t_done_s: float
    selection: int
    result: TrackResult | None
    measurement: BearingMeasurement | None
    frozen: bool
    problem: str | None
    decode_s: float
    track_s: float
    glass_delay: DelayEstimate  # what the pictures tell; what is used is the difference of the first two times
    repeated: bool = False
    predicted: Box | None = None  # the filter's box at capture time
    t_saw_s: float | None = None
    fingerprint: int | None = None
    packet: int | None = None
    told: Told | None = None

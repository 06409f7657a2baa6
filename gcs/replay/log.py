"""A flight's messages by their place in the file: one quick pass finds them, each is decoded when it is wanted."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import msgspec

from control.engagement import Inputs, Output
from control.gimbal import GimbalRequest, GimbalState
from control.latency import UNKNOWN, DelayEstimate
from control.modes import Confirmation
from control.motion import TargetMotion
from control.types import BearingMeasurement, Reason, TargetState, Vec3, VelocityRequest
from gcs.audit import Audit
from gcs.errors import GcsError
from gcs.latency_budget import Budget
from gcs.link_meters import LinkFigures
from gcs.recorder.events import Begun, Expected, Ordered, Received, Refusals, Said, Selected
from gcs.recorder.flight_recorder import MESSAGES
from gcs.recorder.seconds import Seconds
from gcs.regular_file import open_regular
from gcs.replay.order import NEARLY_S, in_order
from gcs.tick import Tick, Wanted
from gcs.vision_tape import Told
from tracker.box import Box, TrackResult


class ReplayError(GcsError):
    """A folder that holds no flight, or none that can be read."""


class _BoxRow(msgspec.Struct, frozen=True):
    cx_px: float | None
    cy_px: float | None
    w_px: float | None
    h_px: float | None


class _ResultRow(msgspec.Struct, frozen=True):
    box: _BoxRow
    score: float | None = None
    confidence: float | None = None
    visible: bool = True


class _DelayRow(msgspec.Struct, frozen=True):
    """A `DelayEstimate`; std_s: None where it was infinite."""

    delay_s: float = UNKNOWN.delay_s
    std_s: float | None = None
    known: bool = False

    @property
    def estimate(self) -> DelayEstimate:
        """As it was."""
        return DelayEstimate(self.delay_s, math.inf if self.std_s is None else self.std_s, self.known)


class FrameRow(msgspec.Struct, frozen=True):
    """A `gcs.recorder.events.FrameRecord` as read back; what was no number there is None."""

    t_capture_s: Seconds
    t_arrival_s: Seconds
    t_done_s: Seconds
    selection: int = 0
    result: _ResultRow | None = None
    measurement: BearingMeasurement | None = None
    problem: str | None = None
    track_s: float = 0.0
    frozen: bool = False
    decode_s: float = 0.0
    glass_delay: _DelayRow = _DelayRow()
    repeated: bool = False
    predicted: Box | None = None
    t_saw_s: Seconds | None = None
    fingerprint: int | None = None
    packet: int | None = None
    told: Told | None = None

    @property
    def tracked(self) -> TrackResult | None:
        """The tracker's answer; None where there was none, or no box in it."""
        if self.result is None:
            return None
        box = self.result.box
        if box.cx_px is None or box.cy_px is None or box.w_px is None or box.h_px is None:
            return None
        found = Box(box.cx_px, box.cy_px, box.w_px, box.h_px)
        return TrackResult(found, self.result.score or 0.0, self.result.confidence or 0.0, self.result.visible)


class Sent(msgspec.Struct, frozen=True):
    """A setpoint as it left; a record, which no wire takes."""

    t_s: Seconds
    velocity_ned_mps: Vec3
    yaw_rate_rps: float


class TickRow(msgspec.Struct, frozen=True):
    """A `Tick` as read back."""

    t_s: Seconds
    inputs: Inputs
    output: Output
    target: TargetState | None
    request: VelocityRequest | None
    setpoint: Sent | None
    gate: Reason
    camera: GimbalState | None = None
    budget: Budget | None = None
    motion: TargetMotion | None = None
    held: Confirmation | None = None
    gimbal: GimbalRequest | None = None
    wanted: Wanted = Wanted()
    changed: Confirmation | None = None

    @property
    def tick(self) -> Tick:
        """The decision for those who watch; without its setpoint, which the gate alone can make."""
        return Tick(
            self.t_s, self.inputs, self.output, self.target, self.request, None, self.gate, self.camera,
            self.gimbal, self.budget, self.motion, self.held, self.wanted, self.changed,
        )  # fmt: skip


class _Head(msgspec.Struct, frozen=True):
    n: int
    t_s: Seconds
    type: str
    frame: int | None = None


class _Line(msgspec.Struct, frozen=True):
    t_s: Seconds
    type: str
    frame: int | None
    data: msgspec.Raw


_KINDS: Final[dict[str, Any]] = {
    "FrameRecord": FrameRow, "Tick": TickRow,
    **{kind.__name__: kind for kind in (Audit, LinkFigures, Begun, Received)},
    **{kind.__name__: kind for kind in (Selected, Expected, Ordered, Said, Refusals)},
}  # fmt: skip
_UNREADABLE: Final = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)  # the last of what is nested without end
_CODES: Final = {kind: code for code, kind in enumerate(_KINDS.values())}
Message = FrameRow | TickRow | Audit | LinkFigures | Begun | Received | Selected | Expected | Ordered | Said | Refusals
Entry = tuple[float, int | None, Message]  # time in s, frame number, what it is


class FlightLog:
    """Of one flight folder, or of a flight broken off at any moment. Raises ReplayError where there is none.

    dropped: messages that the station could not write in time. is_cut: in the middle of its last line, as a program
    leaves it that was ended by force. astray: lines whose time cannot be; they count as the one before.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / MESSAGES
        self.dropped = self.astray = self._broken = self._unread = 0
        self.is_cut = False
        self._times_s, self._offsets, self._codes = array("d"), array("q"), bytearray()
        self._decoder = msgspec.json.Decoder(_Line)
        self._decoders = {name: msgspec.json.Decoder(kind) for name, kind in _KINDS.items()}
        try:
            self._index()
        except OSError as error:
            raise ReplayError(f"{self.path}: {(error.strerror or str(error)).lower()}") from error
        if not self._times_s:
            raise ReplayError(f"{self.path}: no flight in it")
        if next(iter(self), None) is None:  # a dry run without a page thinks in other messages
            raise ReplayError(f"{self.path}: no message of a flight in it; a dry run without --page leaves none")

    def _index(self) -> None:
        decode = msgspec.json.Decoder(_Head).decode
        offset, written = 0, 0
        with open_regular(self.path) as file:
            for line in file:
                try:
                    head = decode(line)
                    line.decode()  # what is passed over is not looked at
                except _UNREADABLE:
                    if line.endswith(b"\n"):
                        self._broken, written = self._broken + 1, written + 1
                    else:
                        self.is_cut = True
                else:
                    self.dropped += max(head.n - written, 0)
                    written = head.n + 1
                    if head.type in _KINDS:
                        self._times_s.append(head.t_s)
                        self._offsets.append(offset)
                        self._codes.append(_CODES[_KINDS[head.type]])
                offset += len(line)
        written_s, self._times_s = self._times_s, in_order(self._times_s)
        self.astray = sum(abs(t_s - at_s) > NEARLY_S for t_s, at_s in zip(written_s, self._times_s, strict=True))

    def __len__(self) -> int:
        return len(self._times_s)

    @property
    def start_s(self) -> float:
        """Time of the first message, on the clock of the flight."""
        return self._times_s[0]

    @property
    def span_s(self) -> float:
        """From the first message to the last."""
        return self._times_s[-1] - self._times_s[0]

    @property
    def damaged(self) -> int:
        """Lines that cannot be read, once all have been gone through."""
        return self._broken + self._unread

    def __iter__(self) -> Iterator[Entry]:
        """All messages in order, decoded one after the other."""
        for entry, _ in self.with_data():
            yield entry

    def with_data(self) -> Iterator[tuple[Entry, msgspec.Raw]]:
        """The same, each with the JSON it was decoded from."""
        self._unread = 0
        return self._found(range(len(self)))

    def read(self, places: Iterable[int]) -> Iterator[Entry]:
        """Those at these places, 0 for the first; what cannot be read is left out."""
        for entry, _ in self._found(places):
            yield entry

    def _found(self, places: Iterable[int]) -> Iterator[tuple[Entry, msgspec.Raw]]:
        with self.path.open("rb") as file:
            for place in places:
                file.seek(self._offsets[place])
                found = self._decoded(file.readline())
                if found is None:
                    continue
                (t_s, frame, message), data = found
                if abs(t_s - self._times_s[place]) > NEARLY_S:
                    t_s = self._times_s[place]
                yield (t_s, frame, message), data

    def places(self, *kinds: type[Message], begin: int = 0, end: int | None = None) -> list[int]:
        """Where messages of these kinds are, from begin to before end."""
        codes = {_CODES[kind] for kind in kinds}
        stop = len(self) if end is None else end
        return [place for place in range(begin, stop) if self._codes[place] in codes]

    def newest(self, kind: type[Message], before: int) -> int | None:
        """Where the last one of this kind before that place is."""
        found = self._codes.rfind(_CODES[kind], 0, max(before, 0))
        return found if found >= 0 else None

    def next(self, kind: type[Message], begin: int) -> int | None:
        """Where the first one of this kind from that place on is."""
        found = self._codes.find(_CODES[kind], begin)
        return found if found >= 0 else None

    def place_at(self, t_s: float) -> int:
        """Of the first message later than this."""
        return bisect_right(self._times_s, t_s)

    def time_s(self, place: int) -> float:
        """Of the message at this place, or the latest before it."""
        return self._times_s[place]

    def _decoded(self, line: bytes) -> tuple[Entry, msgspec.Raw] | None:
        try:
            row = self._decoder.decode(line)
            return (row.t_s, row.frame, self._decoders[row.type].decode(row.data)), row.data
        except (*_UNREADABLE, KeyError):
            self._unread += 1
            return None

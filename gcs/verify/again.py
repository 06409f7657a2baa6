"""A recorded flight once more: every event of its log to the same code, and what came out beside what was recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import msgspec
import numpy as np

from control.modes import FollowMode
from gcs.audit import Audit
from gcs.config import Config
from gcs.flight_control import Act, Wanted
from gcs.flight_view import Sighting
from gcs.flight_vision import Seen
from gcs.recorder.events import Begun, Expected, Received, Selected
from gcs.recorder.flight_recorder import frame_record
from gcs.replay.log import Entry, FrameRow, TickRow
from gcs.tick import Tick
from gcs.verify.outside import FlightAgain, RecordedClock, link_again
from gcs.video import Frame

Events = Iterable[tuple[Entry, msgspec.Raw]]
NO_PICTURE = np.zeros((1, 1, 3), np.uint8)  # of a frame that was not tracked again
_PICTURE = np.zeros((1, 1, 3), np.uint8)  # of one that was


class Listener(Protocol):
    """Is told of each event that came out again, with its recorded JSON."""

    def event(self, what: str, frame: int | None, t_s: float, recorded: msgspec.Raw, again: object) -> None:
        """what: the kind, as in the log."""
        ...


@dataclass(slots=True)
class _Latest:
    """The `Watcher` of the flight."""

    sighting: Sighting | None = None

    def saw(self, sighting: Sighting) -> None:
        self.sighting = sighting

    def ticked(self, tick: Tick) -> None:
        """It is returned by `step`."""

    def audited(self, t_s: float, audit: Audit) -> None:
        """Nobody audits."""

    def note(self, t_s: float, event: object, frame: int | None = None) -> None:
        """What comes from outside is in the record."""


class Again:
    """One flight, without its tracker. config: the flight's, or another one. size: of the pictures (width, height)."""

    def __init__(self, config: Config, size: tuple[int, int], listener: Listener, *, flown: Config) -> None:
        """flown: the configuration of the record; what it wished for by itself, `config` may wish for otherwise."""
        self._config, self._size, self._listener = config, size, listener
        self._wished, self._wishes = wanted_of(flown), wanted_of(config)
        self._clock = RecordedClock()
        self._link, self._end = link_again(config, self._clock)
        self._latest = _Latest()
        self._flight: FlightAgain | None = None

    def run(self, events: Events, seen_of: Callable[[int, FrameRow], Seen]) -> Iterator[Tick | None]:
        """Every event in order; yields each tick as it comes out, None for anything else.

        seen_of: what the tracker made of a frame, by its number and row.
        """
        for (t_s, frame, message), raw in events:
            self._clock.t_s = t_s
            if isinstance(message, Received):
                self._end.received(message.data, None)
            elif isinstance(message, Begun):
                self._begin()
            elif isinstance(message, TickRow):
                yield self._tick(message, raw)
                continue
            elif isinstance(message, FrameRow) and frame is not None:
                self._saw(frame, message, raw, seen_of(frame, message))
            elif isinstance(message, Selected):
                self.flight.control.select(message.target)
            elif isinstance(message, Expected):
                box = self.flight.predicted_at(message.t_capture_s, message.like)
                self._listener.event("Expected", None, t_s, raw, Expected(message.t_capture_s, message.like, box))
            yield None

    @property
    def flight(self) -> FlightAgain:
        """Put together where the record says so, or with the first event that needs it."""
        return self._flight or self._begin()

    def _begin(self) -> FlightAgain:
        flight = self._flight = FlightAgain(self._link, self._size, self._config, self._clock, self._latest)
        flight.watchers = (self._latest,)
        return flight

    def _tick(self, row: TickRow, raw: msgspec.Raw) -> Tick:
        flight, inputs = self.flight, row.inputs
        control = flight.control
        control.wanted = self._wishes if row.wanted == self._wished else row.wanted
        if row.changed is not None:
            control.change(row.changed)
        for act, done in (
            (Act.CONFIRM, inputs.confirm),
            (Act.ABORT, inputs.abort),
            (Act.ACKNOWLEDGE, inputs.acknowledge),
        ):
            if done:
                control.act(act)
        flight.is_fit = inputs.audit_ok
        tick = flight.step(row.t_s)
        self._listener.event("Tick", None, row.t_s, raw, tick)
        return tick

    def _saw(self, number: int, row: FrameRow, raw: msgspec.Raw, seen: Seen) -> None:
        self._clock.t_s = row.t_done_s if row.t_saw_s is None else row.t_saw_s
        self.flight.saw(seen)
        sighting = self._latest.sighting
        assert sighting is not None
        record = frame_record(sighting)
        if seen.frame.image_bgr is NO_PICTURE:  # what only pictures tell is as it was
            record = replace(record, glass_delay=row.glass_delay.estimate)
        self._listener.event("FrameRecord", number, row.t_done_s, raw, record)


def wanted_of(config: Config) -> Wanted:
    """What a flight with this configuration wishes for before any order."""
    follow = config.follow
    return Wanted(FollowMode(follow.mode.value), standoff_m=follow.standoff_m, distance_m=follow.distance_m)


def recorded_seen(number: int, row: FrameRow) -> Seen:
    """What the tracker made of a frame then; without its picture."""
    frame = Frame(number, NO_PICTURE, row.t_capture_s, row.t_arrival_s, row.decode_s, row.packet)
    return Seen(
        frame, row.selection, row.tracked, row.t_done_s, row.track_s, row.frozen, row.problem, row.repeated,
        fingerprint=row.fingerprint, told=row.told,
    )  # fmt: skip


def without_picture(seen: Seen) -> Seen:
    """The same, small enough to be kept for every frame of a flight."""
    return replace(seen, frame=replace(seen.frame, image_bgr=_PICTURE))

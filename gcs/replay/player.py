"""A recorded flight's messages and pictures at the pace that is asked for, on a thread of its own."""

from __future__ import annotations

import math
import queue
import threading
from bisect import bisect_left, bisect_right
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

from gcs.clock import Clock
from gcs.operator.playback import Frames, Play, PlaybackOrder, Seek, Speed
from gcs.recorder.events import Refusals
from gcs.replay.log import FrameRow, TickRow
from gcs.replay.recorded import SHOWN, Moment, Recorded

_LATE_S: Final = 0.2  # behind by more: pictures are left out, decisions are not
_APART_S: Final = 0.03  # between pictures, however fast it is played
_BEFORE_S: Final = 2.0  # so much of the flight before a place tells all that is shown there
_LONGEST_WAIT_S: Final = 3600.0
_CLOSE_S: Final = 5.0


@dataclass(frozen=True, slots=True)
class Jump:
    """Everything that is known at another place of the flight; the last picture is the one to show."""

    moments: tuple[Moment, ...]


@dataclass(frozen=True, slots=True)
class End:
    """There is no more."""


Delivered: TypeAlias = Moment | Jump | End


class Player:
    """Gives everything to `deliver` on its own thread. speed: times faster than it was."""

    def __init__(self, recorded: Recorded, clock: Clock, speed: float, deliver: Callable[[Delivered], None]) -> None:
        self.speed, self.is_playing = speed, True
        self._recorded, self._log, self._clock, self._deliver = recorded, recorded.log, clock, deliver
        self._places = self._log.places(*SHOWN)
        self._frames = self._log.places(FrameRow)
        self._next = 0  # of the places
        self._begun_s = self._from_s = self._shown_s = -math.inf
        self._orders: queue.SimpleQueue[PlaybackOrder | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="replay", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def order(self, order: PlaybackOrder) -> None:
        """From any thread; returns at once."""
        self._orders.put(order)

    def close(self) -> None:
        """End it, wherever it is."""
        self._orders.put(None)
        if self._thread.is_alive():
            self._thread.join(_CLOSE_S)
        self._recorded.film.close()

    # -- on its thread ------------------------------------------------------------------------------------

    def _run(self) -> None:
        self._keep_pace()
        while True:
            try:
                wait_s = self._wait_s()
                order = self._orders.get(wait_s != 0.0, wait_s)
            except queue.Empty:
                if self._clock.now_s() >= self._due_s():
                    self._go_on()
                continue
            if order is None:
                return
            self._obey(order)

    def _keep_pace(self) -> None:
        """As of now and here."""
        self._begun_s, self._from_s = self._clock.now_s(), self._now_s

    @property
    def _now_s(self) -> float:
        """Of the flight."""
        return self._log.time_s(self._places[self._next - 1]) if self._next else self._log.start_s

    def _due_s(self) -> float:
        return self._begun_s + (self._log.time_s(self._places[self._next]) - self._from_s) / self.speed

    def _wait_s(self) -> float | None:
        """Until the next message is due; None: for an order."""
        if not self.is_playing or self._next >= len(self._places):
            return None
        return min(max(0.0, self._due_s() - self._clock.now_s()), _LONGEST_WAIT_S)

    def _go_on(self) -> None:
        now_s, due_s = self._clock.now_s(), self._due_s()
        place = self._places[self._next]
        self._next += 1
        is_due = now_s - due_s < _LATE_S and now_s - self._shown_s > _APART_S
        for moment in self._recorded.moments((place,), pictures=is_due):
            if moment.image_bgr is not None:
                self._shown_s = now_s
            self._deliver(replace(moment, t_s=self._log.time_s(place)))
        if self._next == len(self._places):
            self.is_playing = False
            self._deliver(End())

    def _obey(self, order: PlaybackOrder) -> None:
        match order:
            case Play(on):
                self.is_playing = not self.is_playing if on is None else on
                if self.is_playing and self._next == len(self._places):
                    self._jump(0)
            case Seek(t_s):
                self._jump(bisect_left(self._places, self._log.place_at(self._log.start_s + t_s)))
            case Speed(times):
                self.speed = times
            case Frames(by):
                self.is_playing = False
                self._step(by)
        self._keep_pace()

    def _step(self, by: int) -> None:
        here = self._places[self._next - 1] if self._next else -1
        shown = bisect_right(self._frames, here) - 1  # -1: none yet
        wanted = min(max(shown + by, 0), len(self._frames) - 1)
        if self._frames and wanted != shown:
            self._jump(bisect_right(self._places, self._frames[wanted]))

    def _jump(self, after: int) -> None:
        """So many of the places have been then; the first picture at least, before which there is nothing to see."""
        if not self._places:  # a flight broken off before its video
            return
        first_picture = bisect_right(self._places, self._frames[0]) if self._frames else 1
        self._next = min(max(after, first_picture), len(self._places))
        here = self._places[self._next - 1]
        first = bisect_left(self._places, self._log.place_at(self._log.time_s(here) - _BEFORE_S))
        earlier = (self._log.newest(kind, self._places[first]) for kind in (Refusals, FrameRow, TickRow))
        places = [*sorted(place for place in earlier if place is not None), *self._places[first : self._next]]
        pictured = self._log.newest(FrameRow, here + 1)
        moments = tuple(
            replace(moment, t_s=self._log.time_s(place))
            for place in places
            for moment in self._recorded.moments((place,), pictures=place == pictured)
        )
        self._deliver(Jump(moments))

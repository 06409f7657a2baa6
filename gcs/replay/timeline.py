"""A recorded flight at a glance: its states, what happened in it, and the ways over the ground."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from typing import Final

from control.config import FollowConfig
from control.engagement import State
from control.fence import Fence
from gcs.cli.progress import shown_progress
from gcs.map_paths import target_of
from gcs.operator.playback import Event, Kind, Stretch, Timeline
from gcs.operator.station import Point, Scene
from gcs.recorder.events import Ordered, Said
from gcs.replay.log import Message, TickRow
from gcs.replay.recorded import Recorded
from gcs.tick import Tick

PATH_S: Final = 1.0
_PATH_POINTS: Final = 300
_ENGAGING: Final = "ENGAGING"
_STATES: Final = frozenset({_ENGAGING, *(state.value.upper() for state in State)})


@dataclass(slots=True)
class Path:
    """Where something was, about a point a second."""

    times_s: list[float] = field(default_factory=list)
    points_m: list[Point] = field(default_factory=list)

    def note(self, t_s: float, point_m: Point | None) -> None:
        """None: it is not known."""
        if point_m is not None:
            self.times_s.append(t_s)
            self.points_m.append(point_m)

    def until(self, t_s: float) -> tuple[Point, ...]:
        """The newest points then."""
        end = bisect_right(self.times_s, t_s)
        return tuple(self.points_m[max(0, end - _PATH_POINTS) : end])


@dataclass(frozen=True, slots=True)
class Glance:
    """timeline: with times since the beginning; the paths: with those of the flight's clock."""

    timeline: Timeline
    vehicle: Path
    target: Path
    follow: FollowConfig

    def scene(self, now_s: float, tick: Tick | None, fence: Fence | None) -> Scene:
        """The map then."""
        paths = self.vehicle.until(now_s), self.target.until(now_s)
        if tick is None:
            return Scene(None, 0.0, None, fence, *paths)
        return Scene(_place_of(tick), tick.inputs.vehicle.yaw_rad, target_of(tick, self.follow), fence, *paths)


def glance(recorded: Recorded) -> Glance:
    """Goes through all decisions once: some 20 µs for each."""
    log, follow = recorded.log, recorded.config.control.follow
    places = log.places(TickRow, Ordered, Said)
    making = _Making(log.start_s, follow)
    for t_s, _, message in shown_progress(log.read(places), "reading", "decisions", len(places)):
        making.take(t_s, message)
    return making.glance(log.span_s)


class _Making:
    def __init__(self, start_s: float, follow: FollowConfig) -> None:
        self._start_s, self._follow = start_s, follow
        self._stretches: list[Stretch] = []
        self._events: list[Event] = []
        self._vehicle, self._target = Path(), Path()
        self._state, self._begun_s, self._due_s = "", 0.0, start_s

    def take(self, t_s: float, message: Message) -> None:
        since_s = t_s - self._start_s
        match message:
            case TickRow():
                self._ticked(t_s, since_s, message.tick)
            case Ordered() | Said() if not tells_state(message):
                kind = Kind.SAID if isinstance(message, Said) else Kind.REFUSED if message.refused else Kind.ORDERED
                self._events.append(Event(since_s, kind, words_of(message)))

    def _ticked(self, t_s: float, since_s: float, tick: Tick) -> None:
        output = tick.output
        state = _ENGAGING if output.engaging else output.state.value.upper()
        if state != self._state:
            self._end(since_s)
            self._state, self._begun_s = state, since_s
            reasons = "; ".join(cause.value for cause in output.reasons)
            self._events.append(Event(since_s, Kind.STATE, f"{state}: {reasons}" if reasons else state))
        if t_s >= self._due_s:
            self._due_s = t_s + PATH_S
            self._vehicle.note(t_s, _place_of(tick))
            self._target.note(t_s, target_of(tick, self._follow))

    def _end(self, since_s: float) -> None:
        if self._state:
            self._stretches.append(Stretch(self._begun_s, since_s, self._state))

    def glance(self, span_s: float) -> Glance:
        self._end(span_s)
        events = tuple(sorted(self._events, key=lambda event: event.t_s))  # an order is written when it is answered
        return Glance(Timeline(span_s, tuple(self._stretches), events), self._vehicle, self._target, self._follow)


def words_of(message: Ordered | Said) -> str:
    """As the operator is told."""
    if isinstance(message, Said):
        return message.text
    return f"{message.order}{' refused' if message.refused else ''}: {message.answer}"


def tells_state(message: Ordered | Said) -> bool:
    """It is but the line of a new state, which is shown in any case."""
    return isinstance(message, Said) and message.text.partition(":")[0] in _STATES


def _place_of(tick: Tick) -> Point | None:
    vehicle = tick.inputs.vehicle
    return vehicle.position_ned_m[:2] if vehicle.position_t_s is not None else None

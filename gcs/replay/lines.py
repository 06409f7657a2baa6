"""A recorded flight as lines on a terminal or a pipe."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Final

import msgspec

from gcs.clock import Clock
from gcs.errors import one_line
from gcs.json_line import json_line
from gcs.operator.web.reports import status_report
from gcs.recorder.events import Ordered, Refusals, Said
from gcs.replay.recorded import Moment, Recorded
from gcs.replay.station import ReplayStation
from gcs.replay.timeline import tells_state, words_of

_LINE_S: Final = 5.0  # of the flight, between lines where nothing changes
_LONGEST_WAIT_S: Final = 1e6  # a sleep of many years is none
_REASONS: Final = 3  # in a line; the page and JSON have all
_STATUS_S: Final = 1.0  # the same of JSON lines

Say = Callable[[str], None]
Sleep = Callable[[float], None]


def play_lines(recorded: Recorded, speed: float, say: Say, clock: Clock, sleep: Sleep = time.sleep) -> None:
    """Each change as a line with its time, what was ordered and said, and the state now and then."""
    station = ReplayStation(recorded)
    start_s = recorded.log.start_s
    shown, due_s = "", start_s
    for moment in paced(recorded, speed, clock, sleep):
        station.took(moment)
        at = f"{moment.t_s - start_s:7.1f} s  "
        told = _told(moment)
        if told is not None:
            say(at + one_line(told))
        headline = station.status().headline
        if headline != shown or moment.t_s >= due_s:
            shown, due_s = headline, moment.t_s + _LINE_S
            say(at + one_line(station.status_line()))


def _told(moment: Moment) -> str | None:
    match moment.message:
        case Ordered() | Said() as message if not tells_state(message):
            return f"> {words_of(message)}"
        case Refusals(reasons) if reasons:
            more = f"; {len(reasons) - _REASONS} more" if len(reasons) > _REASONS else ""
            return f"cannot follow: {'; '.join(reasons[:_REASONS])}{more}"
        case Refusals():
            return "can follow"
        case _:
            return None


def play_json(recorded: Recorded, speed: float, say: Say, clock: Clock, sleep: Sleep = time.sleep) -> None:
    """The same as JSON lines: `status` as a flight's own, and `ordered`, `said`, `refusals` with their t_s."""
    station = ReplayStation(recorded)
    shown, due_s = "", recorded.log.start_s
    for moment in paced(recorded, speed, clock, sleep):
        station.took(moment)
        message = moment.message
        if isinstance(message, Ordered | Said | Refusals):
            line = {"type": type(message).__name__.lower(), "t_s": moment.t_s, **msgspec.to_builtins(message)}
            say(json_line(line).rstrip("\n"))
        headline = station.status().headline
        if headline != shown or moment.t_s >= due_s:
            shown, due_s = headline, moment.t_s + _STATUS_S
            say(status_report(station, "", 0).encode().decode())


def paced(recorded: Recorded, speed: float, clock: Clock, sleep: Sleep) -> Iterator[Moment]:
    """Every message when it is due, without pictures."""
    begun_s, start_s = clock.now_s(), recorded.log.start_s
    for moment in recorded.moments(pictures=False):
        while (wait_s := begun_s + (moment.t_s - start_s) / speed - clock.now_s()) > 0:
            sleep(min(wait_s, _LONGEST_WAIT_S))
        yield moment

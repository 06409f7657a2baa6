"""What clients order: who may, what was ordered before, and that each gets its answer. No I/O.

An order that is carried out, or refused, within a moment is answered with that; one that takes longer is answered as
taken, and what becomes of it shows in the tracking status and as a text.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Final, TypeAlias

from gcs.framing import Message
from gcs.operator.camera import commands, messages
from gcs.operator.camera.clients import Client
from gcs.operator.camera.commands import Command
from gcs.operator.camera.messages import Result
from gcs.operator.camera.parameter_types import Told, ack_message
from gcs.operator.camera.setup import CameraSetup
from gcs.operator.lease import Lease
from gcs.operator.orders import Abort, Confirm, Deselect, Order, Select, SelectPoint
from gcs.operator.station import Station

_QUICK_S: Final = 0.3
_PROGRESS_S: Final = 1.0  # a parameter that is still being set says so this often, lest it be sent again
_AGAIN_S: Final = 1.0  # the same wish within this is one that was sent twice
_COUNTED_UP_S: Final = 10.0  # and within this, if it says so itself
# A start of following that was lost on its way back is sent again by QGroundControl 3, 6 and 9 s later; by then the
# operator may have aborted.
_FOLLOW_AGAIN_S: Final = 12.0
_MOST_PENDING: Final = 32
_MOST_REMEMBERED: Final = 64


@dataclass(frozen=True, slots=True)
class Problem:
    """Why the station did not do it. result: what the client is told."""

    result: Result
    why: str


@dataclass(frozen=True, slots=True)
class SetParameter:
    """A parameter that a client wishes to set; name, data and kind as they came, current: its value before."""

    client: Client
    name: bytes
    data: bytes
    kind: int
    current: bytes
    order: Order

    def same_as(self, other: SetParameter) -> bool:
        """Once more the same."""
        return (self.name, self.data, self.kind) == (other.name, other.data, other.kind)


Wish: TypeAlias = Command | SetParameter


@dataclass(frozen=True, slots=True)
class Ask:
    """To be performed by the station; number: tells two alike apart."""

    order: Order
    client: Client
    number: int


@dataclass(frozen=True, slots=True)
class Answer:
    """For a client: a message, and a text for its user."""

    client: Client
    message: Message | None = None
    why: str = ""


@dataclass(slots=True)
class _Job:
    wish: Wish
    begun_s: float
    due_s: float
    problem: Problem | None = None
    done: bool = False
    answered: bool = False


class Orders:
    """Each wish leads to one answer, and to an `Ask` where it may be tried."""

    def __init__(self, setup: CameraSetup, station: Station, lease: Lease) -> None:
        self._delay_s = setup.display_delay_s
        self._station = station
        self._lease = lease
        self._pending: dict[int, _Job] = {}
        self._last: dict[tuple[Client, str], _Job] = {}
        self._numbers = itertools.count(1)
        self._follower: Client | None = None

    def take(self, wish: Wish, now_s: float) -> list[Ask | Answer]:
        """Ordered now. InvalidCommandError for a command that no picture can be meant by."""
        order = self._order_of(wish, now_s)
        before = None if isinstance(order, Abort) else self._before(wish, now_s)
        if before is not None:
            return _told_again(before)
        job = _Job(wish, now_s, now_s + _QUICK_S)
        self._remember(wish, job)
        job.problem = self._refusal(order, wish.client, now_s)
        if job.problem is not None:
            job.done = True
            return [_answer(job)]
        ask = Ask(order, wish.client, next(self._numbers))
        self._pending[ask.number] = job
        return [ask]

    def settled(self, ask: Ask, problem: Problem | None) -> list[Answer]:
        """The station has done it, or not."""
        job = self._pending.pop(ask.number, None)
        if job is None:
            return []
        job.done, job.problem = True, problem
        if problem is None and isinstance(ask.order, Confirm):
            self._follower = ask.client
        if isinstance(job.wish, SetParameter) or not job.answered:
            return [_answer(job)]
        superseded = self._last.get(_key(job.wish)) is not job
        return [Answer(ask.client, why=problem.why)] if problem is not None and not superseded else []

    def overdue(self, now_s: float) -> list[Answer]:
        """What has been waited for long enough."""
        answers = []
        for job in self._pending.values():
            if now_s < job.due_s:
                continue
            answers.append(_answer(job))
            job.due_s = now_s + _PROGRESS_S if isinstance(job.wish, SetParameter) else math.inf
        return answers

    @property
    def due_s(self) -> float:
        """When `overdue` has something to say; infinity: never."""
        return min((job.due_s for job in self._pending.values()), default=math.inf)

    def present(self, client: Client, now_s: float) -> None:
        """It is there. Who began a follow stays in control as long as that lasts; others only some seconds."""
        if client != self._follower:
            return
        if self._station.status().is_engaged:
            self._lease.renew(client.name, now_s)
        else:
            self._follower = None

    def _order_of(self, wish: Wish, now_s: float) -> Order:
        if isinstance(wish, SetParameter):
            return wish.order
        seen = self._station.frames.at(now_s - self._delay_s) if wish.number in commands.SELECTING else None
        return commands.order_of(wish, self._station.size, seen)

    def _refusal(self, order: Order, client: Client, now_s: float) -> Problem | None:
        if isinstance(order, Abort):
            return None
        why = ""
        if len(self._pending) >= _MOST_PENDING:
            why = "too many orders at once"
        elif not self._lease.take(client.name, now_s):
            why = f"{self._lease.holder(now_s)} is in control"
        elif isinstance(order, Select | SelectPoint | Deselect) and self._station.status().is_engaged:
            why = "a target is being followed: abort first"
        elif isinstance(order, Select | SelectPoint) and order.frame is None:
            why = "no picture has come yet"
        return Problem(Result.TEMPORARILY_REJECTED, why) if why else None

    def _before(self, wish: Wish, now_s: float) -> _Job | None:
        """The same, ordered a moment ago and only sent twice."""
        job = self._last.get(_key(wish))
        if job is None:
            return None
        said, window_s = job.wish, _AGAIN_S
        if isinstance(wish, Command) and isinstance(said, Command) and wish.same_as(said):
            window_s = _COUNTED_UP_S if wish.confirmation > said.confirmation else _AGAIN_S
        elif isinstance(wish, SetParameter) and isinstance(said, SetParameter) and wish.same_as(said):
            window_s = _FOLLOW_AGAIN_S if isinstance(wish.order, Confirm) and job.problem is None else _AGAIN_S
        else:
            return None
        return job if now_s - job.begun_s < window_s else None

    def _remember(self, wish: Wish, job: _Job) -> None:
        self._last.pop(_key(wish), None)
        self._last[_key(wish)] = job
        while len(self._last) > _MOST_REMEMBERED:
            del self._last[next(iter(self._last))]


def _key(wish: Wish) -> tuple[Client, str]:
    """What replaces what: a box the one before, a value the one before."""
    if isinstance(wish, SetParameter):
        return wish.client, wish.name.decode("ascii", "replace")
    return wish.client, "film" if wish.number in commands.FILMING else "track"


def _told_again(job: _Job) -> list[Ask | Answer]:
    """The answer once more; none yet where it is still to come."""
    return [_answer(job)] if job.done or job.answered else []


def _answer(job: _Job) -> Answer:
    """What there is to say by now."""
    job.answered = True
    wish, problem = job.wish, job.problem
    client, why = wish.client, "" if problem is None else problem.why
    if isinstance(wish, Command):
        result = Result.ACCEPTED if problem is None else problem.result
        return Answer(client, messages.ack(wish.number, result, client.system_id, client.component_id), why)
    if not job.done:
        return Answer(client, ack_message(wish.name, wish.data, wish.kind, Told.IN_PROGRESS))
    if problem is None:
        return Answer(client, ack_message(wish.name, wish.data, wish.kind, Told.ACCEPTED))
    return Answer(client, ack_message(wish.name, wish.current, wish.kind, Told.REFUSED), why)

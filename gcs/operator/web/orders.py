"""What viewers ask of the station: who may, whether it was meant, and the answer. Abort is everybody's."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Final

from gcs.clock import Clock
from gcs.errors import GcsError
from gcs.operator.attendance import Attendance
from gcs.operator.lease import Lease
from gcs.operator.orders import Abort, Confirm, Order
from gcs.operator.playback import Playback
from gcs.operator.station import Station
from gcs.operator.web import protocol as ask
from gcs.operator.web.translate import order_of, playback_order_of
from gcs.operator.web.viewer import Viewer

_PENDING: Final = 8  # orders of one viewer at the same time
log = logging.getLogger(__name__)

Told = Callable[[Viewer | None, str, str], None]  # who (None: by no WebSocket), the name, and what was done


class Orders:
    """For as long as a station is attached. told: of each order that was carried out; changed: of the lease."""

    def __init__(
        self,
        station: Station,
        lease: Lease,
        clock: Clock,
        told: Told,
        changed: Callable[[], None],
        attendance: Attendance,
    ) -> None:
        self._station, self._lease, self._clock = station, lease, clock
        self._told, self._changed, self._attendance = told, changed, attendance
        self._tasks: set[asyncio.Task[None]] = set()

    async def handle(self, viewer: Viewer, asked: ask.Asked) -> None:
        """Returns at once: an order that takes its time is a task of its own, so that an abort never waits for it."""
        match asked:
            case ask.Abort():
                await self._perform(viewer, asked, Abort())
            case ask.Ping():
                self._lease.renew(viewer.name, self._clock.now_s())
                viewer.answer(asked, True, "")
            case ask.Take(force=force):
                viewer.hold.end()
                if self._may(viewer, asked, by_force=force):
                    viewer.answer(asked, True, "in control")
            case ask.Release():
                viewer.hold.end()
                self._lease.release(viewer.name)
                self._changed()
                viewer.answer(asked, True, "control is free")
            case ask.HoldBegin():
                if self._may(viewer, asked):
                    viewer.hold.begin(self._clock.now_s(), self._station.status().selection)
                    viewer.answer(asked, True, "")
            case ask.HoldEnd():
                viewer.hold.end()
                viewer.answer(asked, True, "")
            case ask.Confirm():
                if self._is_meant(viewer, asked):
                    self._start(viewer, asked)
            case ask.Play() | ask.Seek() | ask.Speed() | ask.Frames():
                self._steer(viewer, asked)
            case _:
                if self._may(viewer, asked):
                    self._start(viewer, asked)

    async def abort(self, name: str) -> tuple[bool, str]:
        """Of somebody without a WebSocket: whether it was done, and the answer."""
        text, ok = await self._performed(name, Abort())
        if ok:
            self._told(None, name, text)
        self._changed()
        return ok, text

    def close(self) -> None:
        """Orders under way are left to the station's end."""
        for task in self._tasks:
            task.cancel()

    def _may(self, viewer: Viewer, asked: ask.Asked, *, by_force: bool = False) -> bool:
        """In control, or now so as nobody was; else it has been refused."""
        now_s = self._clock.now_s()
        before = self._lease.holder(now_s)
        if not self._lease.take(viewer.name, now_s, by_force=by_force):
            viewer.answer(asked, False, f"{before} is in control")
            return False
        if before != viewer.name:
            self._attendance.took(now_s)
            self._told(viewer, viewer.name, f"in control{f' instead of {before}' if before else ''}")
            self._changed()
        return True

    def _is_meant(self, viewer: Viewer, asked: ask.Confirm) -> bool:
        """Confirmation: of who is in control already, after the button was held."""
        now_s = self._clock.now_s()
        problem = viewer.hold.use(now_s, self._station.status().selection)
        if not self._lease.renew(viewer.name, now_s):
            holder = self._lease.holder(now_s)
            problem = f"{holder} is in control" if holder else "control has been lost: hold the button again"
        if problem:
            viewer.answer(asked, False, problem, (problem,))
        return not problem

    def _steer(self, viewer: Viewer, asked: ask.Asked) -> None:
        order = playback_order_of(asked)
        if not isinstance(self._station, Playback) or order is None:
            viewer.answer(asked, False, "this is no recording")
        elif self._may(viewer, asked):
            try:
                self._station.steer(order)
            except ValueError as error:
                viewer.answer(asked, False, str(error))
            else:
                viewer.answer(asked, True, "")

    def _start(self, viewer: Viewer, asked: ask.Asked) -> None:
        if viewer.pending >= _PENDING:
            viewer.answer(asked, False, "too much at once: wait for the answers")
            return
        try:
            order = order_of(asked, self._station)
        except (GcsError, ValueError) as error:
            viewer.answer(asked, False, str(error))
            return
        viewer.pending += 1
        task = asyncio.create_task(self._perform(viewer, asked, order))
        self._tasks.add(task)
        task.add_done_callback(lambda done: self._done(viewer, done))

    def _done(self, viewer: Viewer, task: asyncio.Task[None]) -> None:
        viewer.pending -= 1
        self._tasks.discard(task)

    async def _perform(self, viewer: Viewer, asked: ask.Asked, order: Order) -> None:
        text, ok = await self._performed(viewer.name, order)
        refused = isinstance(order, Confirm) and not ok
        viewer.answer(asked, ok, text, self._station.refusals() if refused else ())
        if ok:
            self._told(viewer, viewer.name, text)
            if isinstance(order, Confirm):
                self._attendance.took(self._clock.now_s())
        self._changed()

    async def _performed(self, name: str, order: Order) -> tuple[str, bool]:
        try:
            return await self._station.perform(order), True
        except (GcsError, ValueError) as error:
            return str(error), False
        except Exception as error:  # an order's edge: a fault in one must not end the page
            log.exception("%s: %s", name, order)
            return f"a fault of this program: {type(error).__name__}", False

"""Tells the audience what a station sees and decides: every text is made once for all, and only if anybody looks."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Final

import msgspec

from control.engagement import State
from gcs.audit import Audit
from gcs.clock import Clock
from gcs.flight_control import Tick
from gcs.flight_view import Sighting
from gcs.operator.lease import Lease
from gcs.operator.playback import Playback
from gcs.operator.station import Station
from gcs.operator.web.audience import Audience
from gcs.operator.web.pictures import Pictures
from gcs.operator.web.report_types import StatusReport
from gcs.operator.web.reports import (
    candidates_report,
    frame_report,
    map_report,
    playhead_report,
    status_report,
    timeline_report,
)

STATUS_S: Final = 0.2
MAP_S: Final = 0.5
CANDIDATES_S: Final = 0.25

log = logging.getLogger(__name__)

_Key = tuple[State, bool, tuple[str, ...], str]


class Feed:
    """A `gcs.flight_view.Watcher` of the station; all of it on the event loop."""

    def __init__(self, station: Station, audience: Audience, pictures: Pictures, lease: Lease, clock: Clock) -> None:
        self._station, self._audience, self._pictures = station, audience, pictures
        self._lease, self._clock = lease, clock
        self._recording = station if isinstance(station, Playback) else None
        self._told: _Key | None = None
        self._failed: type[Exception] | None = None  # each kind of fault is logged once, not twenty times a second

    async def run(self) -> None:
        """Until cancelled: what is told again and again."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._every(STATUS_S, self.tell_status))
            group.create_task(self._every(MAP_S, self._tell_map))
            group.create_task(self._every(CANDIDATES_S, self._tell_candidates))

    async def _every(self, period_s: float, tell: Callable[[], None]) -> None:
        while True:
            if len(self._audience):
                self._safely(tell)
            await asyncio.sleep(period_s)

    def _safely(self, tell: Callable[[], None]) -> None:
        try:
            tell()
        except Exception as error:  # the display's edge: what it cannot show must not end a flight
            if type(error) is not self._failed:
                self._failed = type(error)
                log.exception("the page could not be told")

    def status(self) -> StatusReport:
        """As it is now, for who is not in control."""
        return status_report(self._station, self._holder(), len(self._audience))

    def tell_status(self) -> None:
        """Now; to each whether it is in control."""
        report = self.status()
        data = report.encode()
        other = msgspec.structs.replace(report, in_control=True).encode() if report.controller else data
        self._audience.put_each("status", data, other, report.controller)
        self._tell_playhead()

    def _tell_playhead(self) -> None:
        if self._recording is not None:
            self._audience.put("playhead", playhead_report(self._recording).encode())

    def catch_up(self) -> None:
        """Somebody has come: everything as it is now."""
        if self._recording is not None:
            self._audience.put("timeline", timeline_report(self._recording).encode())
        self.tell_status()
        self._tell_map()
        newest = self._station.frames.newest
        if newest is not None:
            self._pictures.offer(newest)

    def _tell_map(self) -> None:
        self._audience.put("map", map_report(self._station.scene()).encode())

    def _tell_candidates(self) -> None:
        if self._audience.wants_candidates():
            self._audience.put_candidates(candidates_report(self._station).encode())

    def _holder(self) -> str:
        return self._lease.holder(self._clock.now_s())

    def saw(self, sighting: Sighting) -> None:
        """A frame has been through the tracker."""
        if len(self._audience):
            self._safely(lambda: self._tell_frame(sighting))

    def _tell_frame(self, sighting: Sighting) -> None:
        self._audience.put("frame", frame_report(sighting).encode())
        self._tell_playhead()
        if self._audience.wants_picture():
            self._pictures.offer(sighting.seen.frame)
        status = sighting.status
        self._changed(status.state, status.engaging, status.reasons)

    def ticked(self, tick: Tick) -> None:
        """What has changed is told before its turn."""
        if len(self._audience):
            output = tick.output
            reasons = tuple(cause.value for cause in output.reasons)
            self._safely(lambda: self._changed(output.state, output.engaging, reasons))

    def audited(self, t_s: float, audit: Audit) -> None:
        """It stands in the refusals."""

    def _changed(self, state: State, engaging: bool, reasons: tuple[str, ...]) -> None:
        key = (state, engaging, reasons, self._holder())
        if key != self._told:
            self._told = key
            self.tell_status()

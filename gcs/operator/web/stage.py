"""What the page has while a station is attached: feed and pictures for the audience, and what it orders."""

from __future__ import annotations

import asyncio
import importlib.metadata
import logging
import math
from collections.abc import Callable
from typing import Final

from gcs.clock import Clock
from gcs.operator.attendance import LOOK_S, Absence, Attendance
from gcs.operator.config import PageConfig
from gcs.operator.lease import Lease
from gcs.operator.playback import Playback
from gcs.operator.station import Station
from gcs.operator.web import webrtc
from gcs.operator.web.audience import Audience
from gcs.operator.web.feed import Feed
from gcs.operator.web.orders import Orders
from gcs.operator.web.pictures import Picture, Pictures
from gcs.operator.web.viewer import Viewer
from gcs.video_out.peers import Peers

_SNAPSHOT_S: Final = 2.0
log = logging.getLogger(__name__)


class Stage:
    """From attach to detach."""

    def __init__(
        self,
        station: Station,
        config: PageConfig,
        audience: Audience,
        lease: Lease,
        clock: Clock,
        told: Callable[[Viewer | None, str, str], None],
    ) -> None:
        self.station, self.is_replay = station, isinstance(station, Playback)
        # Read and imported now: a viewer that comes in flight must cost no tick.
        self.peers = Peers(station) if webrtc.is_installed() else None
        self.version = importlib.metadata.version("climrt-gcs")
        self._audience = audience
        self._waiting: list[asyncio.Future[Picture]] = []
        self._open = True
        self._pictures = Pictures(config.jpeg_quality, config.most_width_px, self._show)
        self.feed = Feed(station, audience, self._pictures, lease, clock)
        self._lease, self._clock, self._told = lease, clock, told
        self._attendance = Attendance(config.abandoned_s)
        self.orders = Orders(station, lease, clock, told, self.feed.tell_status, self._attendance)
        self._unwatch = station.watch(self.feed)
        loop = asyncio.get_running_loop()
        self._running = loop.create_task(self.feed.run()), loop.create_task(self._attend())

    def close(self) -> None:
        """Nothing of it goes on, but WebRTC until `close_peers`."""
        self._open = False
        self._unwatch()
        for task in self._running:
            task.cancel()
        self.orders.close()
        self._pictures.close()

    async def close_peers(self) -> None:
        """End every WebRTC connection."""
        if self.peers is not None:
            await self.peers.close_all()

    async def _attend(self) -> None:
        """Abort what was confirmed here when nobody is here any more."""
        before = Absence.NONE
        while True:
            try:
                before = await self._attend_once(before)
            except Exception:  # the edge of this task: it has to look again all the same
                log.exception("whether anybody is at the page")
            await asyncio.sleep(LOOK_S)

    async def _attend_once(self, before: Absence) -> Absence:
        absence = self._absence()
        if absence is Absence.LONG and before is Absence.NONE:
            left_s = self._attendance.left_s(self._clock.now_s())
            self._told(None, "page", f"nobody is at the page: the follow ends in {left_s:.0f} s")
        elif absence is Absence.TOO_LONG:
            ok, text = await self.orders.abort("page")
            if before is not Absence.TOO_LONG:
                outcome = "stopped and holding" if ok else text
                self._told(None, "page", f"nobody is at the page any more: {outcome}")
        return absence

    def _absence(self) -> Absence:
        now_s, viewers = self._clock.now_s(), [each for each in self._audience if isinstance(each, Viewer)]
        holder = self._lease.holder(now_s)
        return self._attendance.look(
            now_s,
            max((viewer.heard_s for viewer in viewers), default=-math.inf),
            engaged=self.station.status().is_engaged and not self.is_replay,
            elsewhere=holder not in ("", *(viewer.name for viewer in viewers)),
        )

    async def picture(self) -> Picture | None:
        """The newest; None where none has come yet."""
        newest = self.station.frames.newest
        if newest is None:
            return None
        waiting: asyncio.Future[Picture] = asyncio.get_running_loop().create_future()
        self._waiting.append(waiting)
        self._pictures.offer(newest)
        try:
            async with asyncio.timeout(_SNAPSHOT_S):
                return await waiting
        except TimeoutError:
            return None
        finally:
            self._waiting.remove(waiting)

    def _show(self, picture: Picture) -> None:
        if not self._open:
            return
        for waiting in self._waiting:
            if not waiting.done():
                waiting.set_result(picture)
        self._audience.show(picture)

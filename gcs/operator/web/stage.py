"""What the page has while a station is attached: the feed to the audience, the desk for its orders, the pictures."""

from __future__ import annotations

import asyncio
import importlib.metadata
from collections.abc import Callable
from typing import Final

from gcs.clock import Clock
from gcs.operator.config import PageConfig
from gcs.operator.lease import Lease
from gcs.operator.station import Station
from gcs.operator.web import extras
from gcs.operator.web.audience import Audience
from gcs.operator.web.desk import Desk
from gcs.operator.web.feed import Feed
from gcs.operator.web.pictures import Picture, Pictures
from gcs.operator.web.viewer import Viewer

_SNAPSHOT_S: Final = 2.0


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
        self.station = station
        # Read and imported now: a viewer that comes in flight must cost no tick.
        self.has_webrtc = extras.has_webrtc()
        self.version = importlib.metadata.version("climrt-gcs")
        self._audience = audience
        self._waiting: list[asyncio.Future[Picture]] = []
        self._open = True
        self._pictures = Pictures(config.jpeg_quality, config.most_width_px, self._show)
        self.feed = Feed(station, audience, self._pictures, lease, clock)
        self.desk = Desk(station, lease, clock, told, self.feed.tell_status)
        self._unwatch = station.watch(self.feed)
        self._running = asyncio.get_running_loop().create_task(self.feed.run())

    def close(self) -> None:
        """Nothing of it goes on."""
        self._open = False
        self._unwatch()
        self._running.cancel()
        self.desk.close()
        self._pictures.close()

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

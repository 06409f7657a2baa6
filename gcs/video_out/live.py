"""What the station sees, encoded on a thread of its own while somebody takes it; the newest picture wins."""

from __future__ import annotations

import asyncio
import contextlib
import math
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

from gcs import hud
from gcs.audit import Audit
from gcs.errors import GcsError
from gcs.flight_control import Tick
from gcs.flight_view import Sighting, overlay
from gcs.operator.station import Station
from gcs.video_out.encoder import TICKS_HZ, Coded, Encoder, parameter_sets
from gcs.video_out.own_thread import on_own_thread

_KEY_EVERY_S: Final = 1.0  # at the latest: a receiver that lost something is well again by then
_KEY_APART_S: Final = 0.2  # at the soonest, however often they are asked for
_STILL_S: Final = 1.0  # without a new picture the last one is sent again, with the state as it is now
_CLOSE_S: Final = 5.0

Taker = Callable[[Coded], None]


class LiveStream:
    """A `Watcher` of a station. Everything here is called on the event loop, and so are the takers."""

    def __init__(
        self,
        station: Station,
        bitrate_kbps: int,
        *,
        annotated: bool,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.problem: str | None = None  # why no picture comes, in one line
        self.replaced = 0  # pictures that were not encoded, because a newer one came
        self._station, self._bitrate_kbps, self._annotated, self._now_s = station, bitrate_kbps, annotated, now_s
        self._takers: tuple[Taker, ...] = ()
        self._last: Sighting | None = None
        self._shown_s = 0.0
        self._key_wanted = True
        self._clock = _MediaClock()
        self._waiting: tuple[Sighting, int] | None = None
        self._work = threading.Condition()
        self._closing = False
        self._loop = asyncio.get_running_loop()
        self._ended = asyncio.Event()
        self._end_watch = station.watch(self)
        self._thread = threading.Thread(target=self._run, name="video out", daemon=True)
        self._thread.start()

    @property
    def is_idle(self) -> bool:
        """No picture waits to be encoded."""
        return self._waiting is None

    def take(self, taker: Taker) -> Callable[[], None]:
        """Call it with every picture from the next key frame on; returns how to end that."""
        self._takers = (*self._takers, taker)
        self.want_key()

        def end() -> None:
            self._takers = tuple(each for each in self._takers if each is not taker)

        return end

    def want_key(self) -> None:
        """The next picture shall be one that can be understood alone."""
        self._key_wanted = True

    async def parameter_sets(self) -> tuple[bytes, bytes]:
        """(SPS, PPS) of the station's pictures."""
        return await on_own_thread(partial(parameter_sets, self._station.size, self._bitrate_kbps))

    async def close(self) -> None:
        """End the thread."""
        self._end_watch()
        self._takers = ()
        with self._work:
            self._closing = True
            self._work.notify()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._ended.wait(), _CLOSE_S)

    # -- the watcher --------------------------------------------------------------------------------------

    def saw(self, sighting: Sighting) -> None:
        """Encode it, where somebody takes it."""
        self._last = sighting
        self._offer(sighting, sighting.seen.frame.t_arrival_s)

    def ticked(self, tick: Tick) -> None:
        """Where no picture comes any more, show what has become of it all; the boxes are not true any more."""
        now_s = self._now_s()
        if self._last is None or not self._takers or now_s - self._shown_s < _STILL_S:
            return
        still = replace(self._last, seen=replace(self._last.seen, result=None), predicted=None)
        self._offer(replace(still, status=self._station.status()), now_s)

    def audited(self, t_s: float, audit: Audit) -> None:
        """Nothing is needed of the audit."""

    def _offer(self, sighting: Sighting, t_s: float) -> None:
        if not self._takers:
            return
        self._shown_s = self._now_s()
        with self._work:
            self.replaced += self._waiting is not None
            self._waiting = sighting, self._clock.ticks(t_s, self._shown_s)
            self._work.notify()

    # -- the thread ---------------------------------------------------------------------------------------

    def _next(self) -> tuple[Sighting, int] | None:
        with self._work:
            self._work.wait_for(lambda: self._waiting is not None or self._closing)
            taken, self._waiting = self._waiting, None
            return None if self._closing else taken

    def _run(self) -> None:
        try:
            self._encode()
        finally:
            self._tell(self._ended.set)

    def _encode(self) -> None:
        encoder: Encoder | None = None
        key_s = -math.inf
        while (work := self._next()) is not None:
            sighting, ticks = work
            image, now_s = sighting.seen.frame.image_bgr, self._now_s()
            size, fps = (image.shape[1], image.shape[0]), sighting.status.video_fps
            key = now_s - key_s >= (_KEY_APART_S if self._key_wanted else _KEY_EVERY_S)
            try:
                if encoder is None or encoder.size != size or (key and not encoder.suits(size, fps)):
                    encoder, key = Encoder(size, self._bitrate_kbps, fps), True
                coded = encoder.encode(self._drawn(sighting), sighting.seen.frame.seq, ticks, key=key)
            except GcsError as error:
                self.problem, encoder = str(error), None
                continue
            if coded.is_key:
                key_s, self._key_wanted = now_s, False
            self._tell(partial(self._deliver, coded))

    def _tell(self, what: Callable[[], None]) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended without us
            self._loop.call_soon_threadsafe(what)

    def _drawn(self, sighting: Sighting) -> hud.Image:
        if not self._annotated:
            return sighting.seen.frame.image_bgr
        return hud.draw(sighting.seen.frame.image_bgr, overlay(sighting, self._station.watermark))

    def _deliver(self, coded: Coded) -> None:
        self.problem = None
        for taker in self._takers:
            taker(coded)


class _MediaClock:
    """Arrival times in ticks that only grow; a recording's own times, or a jump in them, are moved to now."""

    _FAR_S: Final = 0.5

    def __init__(self) -> None:
        self._offset_s = 0.0
        self._last = 0

    def ticks(self, t_s: float, now_s: float) -> int:
        if abs(t_s + self._offset_s - now_s) > self._FAR_S:
            self._offset_s = now_s - t_s
        self._last = max(self._last + 1, round((t_s + self._offset_s) * TICKS_HZ))
        return self._last

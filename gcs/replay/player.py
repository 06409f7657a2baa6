"""A recorded flight's messages and pictures at their own pace, on a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from gcs.clock import Clock
from gcs.replay.film import Film
from gcs.replay.log import FlightLog, FrameRow, Message
from gcs.video.frame import Image

_LATE_S: Final = 0.2  # behind by more: pictures are left out, decisions are not
_CLOSE_S: Final = 5.0


@dataclass(frozen=True, slots=True)
class Moment:
    """One message at its time; image_bgr: the picture of a frame, None where it is left out or no frame."""

    t_s: float
    frame: int | None
    message: Message
    image_bgr: Image | None = None


class Player:
    """Gives each moment to `deliver` on its own thread, None after the last. speed: times faster than it was."""

    def __init__(
        self,
        log: FlightLog,
        film: Film,
        clock: Clock,
        speed: float,
        deliver: Callable[[Moment | None], None],
    ) -> None:
        self._log, self._film, self._clock, self._speed = log, film, clock, speed
        self._deliver = deliver
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="replay", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def close(self) -> None:
        """End it, wherever it is."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(_CLOSE_S)
        self._film.close()

    def _run(self) -> None:
        for moment in self.moments():
            self._deliver(moment)
        if not self._stop.is_set():
            self._deliver(None)

    def moments(self, *, pictures: bool = True) -> Iterator[Moment]:
        """Each when it is due; on the caller's thread."""
        begun_s, latest_s = self._clock.now_s(), self._log.start_s
        for t_s, number, message in self._log:
            latest_s = max(latest_s, t_s)  # the log is in the order of writing, which time is nearly
            wait_s = begun_s + (latest_s - self._log.start_s) / self._speed - self._clock.now_s()
            if wait_s > 0:
                self._stop.wait(wait_s)
            if self._stop.is_set():
                return
            image_bgr = None
            if pictures and isinstance(message, FrameRow) and wait_s > -_LATE_S:
                image_bgr = self._film.picture_of(message)
            yield Moment(latest_s, number, message, image_bgr)

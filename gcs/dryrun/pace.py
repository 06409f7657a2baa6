"""A recorded video played as a live one comes: at its own pace, the newest picture first, on the flight's clock."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from typing import Final

from gcs.clock import Clock
from gcs.errors import VideoError
from gcs.video import Frame, VideoSource
from gcs.video.frame import Image

_STILL_S: Final = 0.1  # so often a picture that stands still is given again: an older one is no video


class Place(Enum):
    """Where in the video a picture stands."""

    START = "start"  # and it stays until `play`
    PLAYING = "playing"
    END = "end"  # and it stays until `rewind`


@dataclass(frozen=True, slots=True)
class FilmFrame(Frame):
    """A frame of a recorded video with its number there, from 0, and its time (s) there."""

    index: int = 0
    t_video_s: float = 0.0
    place: Place = Place.PLAYING


def stands_at_first(frame: Frame) -> bool:
    """Whether this is the first picture, waiting."""
    return isinstance(frame, FilmFrame) and frame.place is Place.START


class PacedSource:
    """A `VideoSource` of `FilmFrame`s. Read on one thread; `play`, `rewind` and `close` come from any.

    What is read too late is skipped, as it would be in flight. A picture that stands still is given again and again,
    so that whoever looks for the first time sees it too. limit_s: the video counts as ended there.
    """

    is_live = True
    frame_count = None

    def __init__(self, open_again: Callable[[], VideoSource], clock: Clock, limit_s: float | None = None) -> None:
        """open_again: opens the video at its start. Raises what that raises, and VideoError without a picture."""
        self._open, self._clock, self._limit_s = open_again, clock, limit_s
        self._source = open_again()
        self.name, self.size, self.fps = self._source.name, self._source.size, self._source.fps
        self.ended = False
        self.problem: str | None = None
        self._asked: Place | None = None
        self._woken = threading.Event()
        self._seq = 0
        self._ahead: Frame | None = None
        self._start_s = 0.0
        self._last = self._first()

    def play(self) -> None:
        """Go on from the first picture."""
        self._ask(Place.PLAYING)

    def rewind(self) -> None:
        """Back to the first picture, and wait there."""
        self._ask(Place.START)

    def _ask(self, place: Place) -> None:
        self._asked = place
        self._woken.set()

    def read(self, timeout_s: float | None = None) -> Frame | None:
        """The newest frame that is due, at most timeout_s from now."""
        self._obey()
        if self.ended:
            return None
        found = self._newest_due()
        if found is None:
            wait_s = max(self._due_s() - self._clock.now_s(), 0.0)
            self._woken.wait(wait_s if timeout_s is None else min(wait_s, timeout_s))
            self._obey()
            found = self._newest_due()
        return found

    def close(self) -> None:
        """Wake the reader; its thread must have ended before the file is closed."""
        self.ended = True
        self._woken.set()
        self._source.close()

    def _obey(self) -> None:
        self._woken.clear()
        asked, self._asked = self._asked, None
        if asked is Place.PLAYING and self._last.place is Place.START:
            self._last = replace(self._last, place=Place.PLAYING)
            self._start_s = self._clock.now_s()
            self._look_ahead()
        elif asked is Place.START:
            self._rewind()

    def _rewind(self) -> None:
        self._source.close()
        try:
            self._source = self._open()
            self._last = self._first()
        except VideoError as error:
            self.problem, self.ended = str(error), True

    def _first(self) -> FilmFrame:
        """The first picture, not given yet."""
        first = self._source.read()
        if first is None:
            raise VideoError(self._source.problem or f"{self._source.name}: no picture in it")
        self._ahead = None
        return FilmFrame(self._seq, first.image_bgr, 0.0, 0.0, place=Place.START)

    def _newest_due(self) -> FilmFrame | None:
        now_s = self._clock.now_s()
        if self.ended or now_s < self._due_s():
            return None
        if self._last.place is not Place.PLAYING:
            return self._again(now_s)
        found = self._last
        while (ahead := self._ahead) is not None and self._start_s + ahead.t_capture_s <= now_s:
            self._seq += 1
            t_s = self._start_s + ahead.t_capture_s
            found = FilmFrame(self._seq, ahead.image_bgr, t_s, t_s, index=ahead.seq, t_video_s=ahead.t_capture_s)
            self._look_ahead()
        self._last = found if self._ahead is not None else replace(found, place=Place.END)
        return found

    def _again(self, now_s: float) -> FilmFrame:
        """The picture that stands still, once more."""
        self._seq += 1
        image_bgr = _unlike(self._last.image_bgr)
        self._last = replace(self._last, seq=self._seq, image_bgr=image_bgr, t_capture_s=now_s, t_arrival_s=now_s)
        return self._last

    def _due_s(self) -> float:
        if self._last.place is Place.PLAYING:
            return 0.0 if self._ahead is None else self._start_s + self._ahead.t_capture_s
        return self._last.t_arrival_s + _STILL_S if self._last.t_arrival_s else 0.0

    def _look_ahead(self) -> None:
        ahead = self._source.read()
        if ahead is not None and self._limit_s is not None and ahead.t_capture_s > self._limit_s:
            ahead = None
        if ahead is None:
            self.problem = self._source.problem
        self._ahead = ahead


def _unlike(image_bgr: Image) -> Image:
    """The same to the eye, but not the same: in flight one picture again and again is a fault of the video."""
    other = image_bgr.copy()
    other[0, 0, 0] ^= 1
    return other

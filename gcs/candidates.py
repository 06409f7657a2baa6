"""What in the picture might be a target: numbered boxes to choose from, and the box round a point."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

from gcs.candidates_box import box_at, inside
from gcs.candidates_motion import moving
from gcs.video.frame import Frame, Image
from gcs.video.history import FrameHistory
from tracker.box import Box

__all__ = ["Candidate", "CandidateFinder", "box_at"]

MOST: Final = 9  # one key each
_LOOK_S: Final = 0.25
_ASKED_S: Final = 2.0  # unasked for so long, it stops looking
_BEFORE_S: Final = (0.4, 0.8)  # the pictures that the newest is compared with
_STILL_LOOKS: Final = 4  # without anything that moves: then every second one takes what is in the middle
_TIMES_SEEN: Final = 2  # before it is shown: what is seen once is noise
_SHOWN_S: Final = 0.6  # since it was last seen
_NEAR_PX: Final = 24.0  # so far anything may come from one look to the next, the camera turning
_NUMBER_S: Final = 4.0  # a number belongs to what it was so long after it was last seen


@dataclass(frozen=True, slots=True)
class Candidate:
    """Keeps its number as long as it is seen; box in px of the frame it was found in."""

    number: int
    box: Box
    frame: Frame | None = None


@dataclass(frozen=True, slots=True)
class _Known:
    candidate: Candidate
    seen_t_s: float
    times: int = 1


class Numbers:
    """Gives found boxes numbers from 1 to 9 and keeps them from look to look. Not to be shared between threads."""

    def __init__(self) -> None:
        self._known: dict[int, _Known] = {}

    def update(self, boxes: Iterable[Box], t_s: float, frame: Frame | None = None) -> None:
        """What one look has found, the most important first."""
        self._known = {n: known for n, known in self._known.items() if t_s - known.seen_t_s <= _NUMBER_S}
        free = [n for n in range(1, MOST + 1) if n not in self._known]
        unmatched = dict(self._known)
        for box in boxes:
            same = min(unmatched, key=lambda n: _apart(unmatched[n].candidate.box, box), default=None)
            if same is not None and _apart(unmatched[same].candidate.box, box) < 1.0:
                times = unmatched.pop(same).times + 1
                self._known[same] = _Known(Candidate(same, box, frame), t_s, times)
            elif free:
                number = free.pop(0)
                self._known[number] = _Known(Candidate(number, box, frame), t_s)

    def shown(self, t_s: float) -> tuple[Candidate, ...]:
        """By their numbers."""
        return tuple(
            known.candidate
            for _, known in sorted(self._known.items())
            if known.times >= _TIMES_SEEN and t_s - known.seen_t_s <= _SHOWN_S
        )


def _apart(a: Box, b: Box) -> float:
    """How far, in their own sizes: under 1 they can be the same thing a moment later; infinite if too unlike."""
    if not 1 / 3 < (a.w_px * a.h_px) ** 0.5 / max((b.w_px * b.h_px) ** 0.5, 1e-9) < 3:
        return float("inf")
    wide, high = max(a.w_px, b.w_px, _NEAR_PX), max(a.h_px, b.h_px, _NEAR_PX)
    return max(abs(a.cx_px - b.cx_px) / wide, abs(a.cy_px - b.cy_px) / high)


class CandidateFinder:
    """Looks on a thread of its own, four times a second, while `now` is being asked; else it costs nothing."""

    def __init__(self, frames: FrameHistory, now_s: Callable[[], float] = time.monotonic) -> None:
        self._frames, self._now_s = frames, now_s
        self._numbers = Numbers()
        self._seq = -1
        self._quiet = 0
        self._found: tuple[Candidate, ...] = ()
        self._asked_s = -_ASKED_S
        self._wake = threading.Event()
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None

    def now(self) -> tuple[Candidate, ...]:
        """What moves, by its number, and where nothing does what stands in the middle; empty at the first call."""
        now_s = self._now_s()
        if now_s - self._asked_s > _ASKED_S:
            self._found = ()
        self._asked_s = now_s
        if self._thread is None and not self._closed.is_set():
            self._thread = threading.Thread(target=self._run, name="candidates", daemon=True)
            self._thread.start()
        self._wake.set()
        return self._found

    def close(self) -> None:
        """End the thread."""
        self._closed.set()
        self._wake.set()
        if self._thread is not None:
            self._thread.join(1.0)

    def _run(self) -> None:
        while True:
            self._wake.clear()  # before the look at what may have woken it
            if self._closed.is_set():
                return
            if self._now_s() - self._asked_s > _ASKED_S:
                self._wake.wait()
                continue
            self.look()
            self._closed.wait(_LOOK_S)

    def look(self) -> None:
        """Once, on this thread."""
        newest = self._frames.newest
        if newest is None or newest.seq == self._seq:
            return
        self._seq = newest.seq
        t_s = newest.t_arrival_s
        earlier = {each.seq: each for dt_s in _BEFORE_S if (each := self._frames.at(t_s - dt_s)) is not None}
        earlier.pop(newest.seq, None)
        found = moving([each.image_bgr for each in earlier.values()], newest.image_bgr)
        boxes = [inside(each.box, newest.image_bgr) for each in found[:MOST]]
        self._quiet = 0 if boxes else self._quiet + 1
        if self._quiet >= _STILL_LOOKS:
            self._quiet -= 2
            boxes = [_middle(newest.image_bgr)]
        self._numbers.update(boxes, t_s, newest)
        self._found = self._numbers.shown(t_s)


def _middle(image_bgr: Image) -> Box:
    height, width = image_bgr.shape[:2]
    return box_at(image_bgr, width / 2, height / 2)

"""The vision of a recorded flight, again: the film's pictures through the real `Vision`, told what it was told then."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from gcs.errors import GcsError
from gcs.flight_vision import Seen, Vision
from gcs.recorder.events import Selected
from gcs.replay.log import FrameRow
from gcs.tracking import BoxTracker
from gcs.video import Frame
from gcs.video.frame import Image
from gcs.vision_tape import Arrival, Told
from tracker.box import Box

Pictures = Callable[[FrameRow], Image | None]
_KEPT = 2000  # rows: a selection is drawn on a picture of the last seconds


class DivergedError(GcsError):
    """The tracker cannot go on as it did: what it was given then is not in the record."""


@dataclass(slots=True)
class _Taped:
    """Source, clock, correction and expectation of the steps, from their tape. `gcs.video.VideoSource` in part."""

    frame_of: Callable[[Arrival], Frame]
    name: str = "recorded"
    is_live: bool = True
    fps: float | None = None
    frame_count: int | None = None
    ended: bool = False
    problem: str | None = None
    size: tuple[int, int] = (0, 0)
    expected: Box | None = None
    wrong: str | None = None
    _times_s: deque[float] = field(default_factory=deque)
    _arrivals: deque[Arrival | None] = field(default_factory=deque)
    _corrections_s: deque[float] = field(default_factory=deque)

    def load(self, told: Told) -> Frame:
        """The step to come; the frame it begins with."""
        self.expected = told.expected
        self._times_s = deque(told.times_s)
        self._arrivals = deque(told.arrivals[1:])
        self._corrections_s = deque(each.correction_s for each in told.arrivals if each is not None)
        first = told.arrivals[0]
        if first is None:
            raise DivergedError("the record of a step names no frame")
        return self.frame_of(first)

    def now_s(self) -> float:
        if len(self._times_s) == 1:
            return self._times_s[0]  # of a step that took another course: its `told` shows it
        return self._times_s.popleft()

    def read(self, timeout_s: float | None = None) -> Frame | None:
        arrival = self._arrivals.popleft() if self._arrivals else None
        try:
            return None if arrival is None else self.frame_of(arrival)
        except DivergedError as error:  # `Vision` would take it for a fault of the tracker
            self.wrong = str(error)
            return None

    def correction_s(self) -> float:
        return self._corrections_s.popleft() if self._corrections_s else 0.0

    def expect(self, t_capture_s: float, like: Box) -> Box | None:
        return self.expected

    def close(self) -> None:
        """Nothing is open."""


class EyesAgain:
    """Give it every row and selection in the order of the log. tracker: as the flight's, its weights loaded.

    pictures: of a row; None where the film does not hold it, which raises DivergedError.
    """

    def __init__(self, tracker: BoxTracker, pictures: Pictures) -> None:
        self._pictures = pictures
        self._rows: dict[int, FrameRow] = {}
        self._taped = taped = _Taped(self._frame)
        self._delivered: list[Seen] = []
        self._pending: list[Selected] = []
        self._vision = Vision(taped, tracker, taped, self._delivered.append, taped.expect, taped.correction_s)

    def selected(self, selected: Selected) -> None:
        """The operator's."""
        if selected.number:
            self._pending.append(selected)

    def saw(self, seq: int, row: FrameRow) -> list[Seen]:
        """What the tracker makes of this row and of those that passed by before it; empty for one that passes by."""
        self._rows[seq] = row
        if len(self._rows) > _KEPT:
            del self._rows[next(iter(self._rows))]
        if row.told is None:
            return []
        frame = self._taped.load(row.told)
        self._select(row.told.selection)
        self._delivered.clear()
        last = self._vision.step(frame)
        if self._taped.wrong is not None:
            raise DivergedError(self._taped.wrong)
        return [*self._delivered, last]

    def _select(self, number: int) -> None:
        while self._pending and self._pending[0].number <= number:
            selected = self._pending.pop(0)
            row = None if selected.seen_on is None else self._rows.get(selected.seen_on)
            frame = None
            if row is not None and selected.seen_on is not None:
                frame = Frame(selected.seen_on, self._image(row), row.t_capture_s, row.t_arrival_s, row.decode_s)
            self._vision.select(selected.box, frame)

    def _frame(self, arrival: Arrival) -> Frame:
        row = self._rows.get(arrival.seq)
        if row is None:
            raise DivergedError(f"frame {arrival.seq} was tracked, but nothing else is recorded of it")
        return Frame(arrival.seq, self._image(row), arrival.t_source_s, row.t_arrival_s, row.decode_s, row.packet)

    def _image(self, row: FrameRow) -> Image:
        image_bgr = self._pictures(row)
        if image_bgr is None:
            raise DivergedError("the film does not hold the picture")
        return image_bgr

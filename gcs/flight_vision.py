"""Eyes of a flight: reads the newest frame and tracks the selection in it, on one thread of its own.

Never on asyncio's default threads, which MAVSDK and file work share; PyTorch and OpenCV release the
interpreter lock, so the 20 Hz control task goes on meanwhile.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2

from control.image_rotation import Flow
from gcs.clock import Clock
from gcs.tracking import BoxTracker, Learner
from gcs.video import Frame, VideoSource
from gcs.video.catch_up import CATCH_UP_S, next_frame
from gcs.video.flow import BackgroundFlow
from gcs.video.frame import fingerprint
from gcs.video.history import FrameHistory
from gcs.video.live import LiveSource
from gcs.vision_tape import Arrival, Tape, Told
from tracker.box import Box, TrackResult

_READ_S = 0.2
_CLOSE_S = 5.0
_FROZEN_FRAMES, _FROZEN_S = 10, 0.5
_SMOOTH = 0.2
log = logging.getLogger(__name__)

# Where a hidden target should be in the frame captured at this time (s), shaped like this box; None = unknown.
Expect = Callable[[float, Box], Box | None]


@dataclass(frozen=True, slots=True)
class Seen:
    """What became of one frame.

    selection: which selection it belongs to, counted from 1; 0 = nothing is selected.
    result: None where nothing is tracked, the video stands still, or the tracker failed (`problem`).
    track_s: time the tracker took. t_done_s: when the result was there (monotonic). flow: how the background has
    moved since the picture before, where that can be told. told: see `gcs.vision_tape`; None for a frame that passed by
    while the tracker caught up with a selection.
    """

    frame: Frame
    selection: int
    result: TrackResult | None
    t_done_s: float
    track_s: float = 0.0
    frozen: bool = False
    problem: str | None = None
    repeated: bool = False  # the same picture as the last: it tells nothing new, whatever the tracker says
    flow: Flow | None = None
    fingerprint: int | None = None
    told: Told | None = None


@dataclass(frozen=True, slots=True)
class _Selection:
    number: int
    box: Box | None  # None = forget the target
    frame: Frame | None


class StillPicture:
    """Notices a video that repeats one picture under new time stamps."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._same = 0
        self._since_s = 0.0

    def update(self, fingerprint: int, t_s: float) -> bool:
        """Give it every picture's fingerprint: True from the tenth equal one on, if they span half a second."""
        if self._last == fingerprint:
            self._same += 1
        else:
            self._last, self._same, self._since_s = fingerprint, 1, t_s
        return self._same >= _FROZEN_FRAMES and t_s - self._since_s >= _FROZEN_S

    @property
    def repeats(self) -> bool:
        """Whether the newest picture equals the one before it."""
        return self._same > 1


class Vision:
    """Give it selections from any thread; it gives each frame to `deliver` on its own thread."""

    def __init__(
        self,
        source: VideoSource,
        tracker: BoxTracker,
        clock: Clock,
        deliver: Callable[[Seen], None],
        expect: Expect | None = None,
        correction_s: Callable[[], float] = lambda: 0.0,
    ) -> None:
        """correction_s: what capture times are too late by, asked at every frame on the vision thread."""
        self._correction_s = correction_s
        self._background = BackgroundFlow()
        self._source = source
        self._tracker = tracker
        self._tape = self._clock = Tape(clock)
        self._deliver = deliver
        self._expect = expect
        self._hidden_like: Box | None = None  # the last box, while the target is hidden
        self._still = StillPicture()
        self._frozen = False
        self._fingerprint = 0  # of the newest picture
        self._update_s = 0.0  # what the tracker takes for a frame, 0 = not known yet
        self.frames = FrameHistory()
        self._lock = threading.Lock()
        self._asked: _Selection | None = None
        self._selections = 0
        self._tracking = 0  # number of the selection the tracker holds, 0 = none
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="vision", daemon=True)

    def select(self, box: Box | None, frame: Frame | None = None) -> int:
        """Track the box from its frame (None: the next one) on; box None forgets. Returns its number.

        From an older frame the target is first followed through the frames kept since, for at most `CATCH_UP_S`.
        """
        with self._lock:
            self._selections += 1
            self._asked = _Selection(self._selections, box, frame)
            return self._selections

    def step(self, frame: Frame) -> Seen:
        """Track in one frame, what `run` does for each: this one, or a newer that came while it caught up.

        Only one thread may call it.
        """
        seen = self._step(self._arrived(frame))
        return replace(seen, fingerprint=self._fingerprint, told=self._tape.taken())

    def _step(self, frame: Frame) -> Seen:
        with self._lock:
            asked, self._asked = self._asked, None
        self._tape.selection = asked.number if asked is not None else 0
        try:
            if asked is not None:
                frame = self._begin(asked, frame)
            t_start_s = self._clock.now_s()
            result = self._track(frame)
        except ValueError as error:  # a box or picture that cannot be tracked
            return self._failed(frame, asked, str(error))
        except Exception as error:  # the edge of the tracker's thread: out of memory, a fault of torch
            log.exception("tracker")
            return self._failed(frame, asked, f"the tracker failed: {type(error).__name__}")
        flow = None if self._still.repeats else self.flow(frame, result.box if result is not None else None)
        now_s = self._clock.now_s()
        if self._frozen:
            return Seen(frame, self._tracking, None, now_s, now_s - t_start_s, True, "the picture stands still")
        repeats, took_s = self._still.repeats, now_s - t_start_s
        return Seen(frame, self._tracking, result, now_s, took_s, repeated=repeats, flow=flow)

    def _arrived(self, frame: Frame) -> Frame:
        """Keep it, with the capture time as we know it."""
        correction_s = self._correction_s()
        self._tape.arrived(Arrival(frame.seq, frame.t_capture_s, correction_s))
        frame = replace(frame, t_capture_s=frame.t_capture_s - correction_s)
        self.frames.add(frame)
        self._fingerprint = fingerprint(frame.image_bgr)
        self._frozen = self._still.update(self._fingerprint, frame.t_arrival_s)
        return frame

    def flow(self, frame: Frame, target: Box | None) -> Flow | None:
        """How the background has moved since the frame before; target: where the target is now, or was last seen."""
        try:
            return self._background.update(frame.image_bgr, frame.t_arrival_s, target)
        except cv2.error:  # no reason to see nothing
            return None

    def _begin(self, asked: _Selection, frame: Frame) -> Frame:
        """Take or drop a target; the frame to track it in."""
        self._tracking, self._hidden_like = 0, None
        if asked.box is None:
            return frame
        first = asked.frame or frame
        self._tracker.init(first.image_bgr, asked.box)
        frame = self._catch_up(first, frame)
        self._tracking = asked.number
        return frame

    def _catch_up(self, first: Frame, frame: Frame) -> Frame:
        """Follow the target through what was seen since `first`, up to the newest frame, which is left to do.

        The boxes on the way are told to nobody: nobody can confirm that soon, and the filter starts with the newest.
        Neither is the filter asked where to look, for it still knows the target before. Frames that come meanwhile
        are delivered without a result, so that what shows them does not stand still.
        """
        end_s = self._clock.now_s() + CATCH_UP_S
        last = first
        while True:
            newer = self._source.read(0.0) if self._source.is_live else None
            if newer is not None:
                now_s, frozen = self._clock.now_s(), self._frozen
                self._deliver(Seen(frame, 0, None, now_s, frozen=frozen, fingerprint=self._fingerprint))
                frame = self._arrived(newer)
            else:
                self._tape.arrived(None)
            left_s = end_s - self._clock.now_s()
            step = next_frame(self.frames.since(last.seq), last.t_arrival_s, self._update_s, left_s)
            if step is None or step.seq >= frame.seq:
                return frame
            self._update(step)
            last = step

    def _track(self, frame: Frame) -> TrackResult | None:
        if not self._tracking:
            return None
        if self._hidden_like is not None and self._expect is not None:
            expected = self._tape.expected = self._expect(frame.t_capture_s, self._hidden_like)
            if expected is not None:
                self._tracker.look_at(expected.cx_px, expected.cy_px)
        result = self._update(frame)
        self._hidden_like = None if result.visible else result.box
        return result

    def _update(self, frame: Frame) -> TrackResult:
        """The tracker's, and how long it takes."""
        start_s = self._clock.now_s()
        result = self._tracker.update(frame.image_bgr)
        took_s = self._clock.now_s() - start_s
        self._update_s = took_s if self._update_s == 0.0 else self._update_s + _SMOOTH * (took_s - self._update_s)
        return result

    def _failed(self, frame: Frame, asked: _Selection | None, problem: str) -> Seen:
        number = asked.number if asked is not None else self._tracking
        self._tracking = 0
        return Seen(frame, number, None, self._clock.now_s(), problem=problem)

    @property
    def selections(self) -> int:
        """How many there were: the number of the newest."""
        return self._selections

    @property
    def trouble(self) -> str:
        """What is wrong with a live video now, in one line for the operator; empty when nothing is."""
        return self._source.trouble if isinstance(self._source, LiveSource) else ""

    def start(self) -> None:
        """Begin reading."""
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.is_set() and not self._source.ended:
            frame = self._source.read(_READ_S)
            if frame is not None and not self._stop.is_set():
                self._deliver(self.step(frame))
                self._learn()

    def _learn(self) -> None:
        """Between this picture and the next: what commands wait for is out."""
        try:
            if isinstance(self._tracker, Learner):
                self._tracker.learn()
        except Exception:  # the edge of the tracker's thread; without this lesson it goes on
            log.exception("tracker: learning")

    def close(self) -> None:
        """Stop the thread (waits for the frame under way) and close the video."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(_CLOSE_S)
        self._source.close()

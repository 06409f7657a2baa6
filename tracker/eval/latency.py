"""The score that matters in flight: frames arrive on a clock, and answers count from when they are there.

At the time of frame k only the newest answer that was finished by then exists; that one is scored against the truth
of frame k (streaming perception, Li et al., ECCV 2020, section 3; for trackers Li et al., PVT++, ICCV 2023). So even
a fast tracker is judged one frame late, and a slow one skips frames: the newest that has arrived is next. The clock
is virtual: each update advances it by its own measured time, nothing sleeps.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from tracker.box import Box
from tracker.eval.ope import Score, score
from tracker.eval.sequences import Sequence

if TYPE_CHECKING:
    from tracker.eval.run import Tracker

Array = NDArray[np.float64]
# Two clocks that are built from the same numbers may differ in the last bit.
TINY_S = 1e-9


class Predictor(Protocol):
    """Where the box will be, from the answers so far. Times are those of the frames (capture), seconds."""

    def observe(self, t_s: float, box_xywh: Array) -> None:
        """An answer (4,) x,y,w,h px to the frame of that time; times rise."""

    def predict(self, t_s: float) -> Array:
        """The box (4,) x,y,w,h px at a time not before the newest answer's."""


class ConstantVelocity:
    """The plainest predictor: centre and size go on as between the last two answers."""

    def __init__(self) -> None:
        self._answers: list[tuple[float, Array]] = []

    def observe(self, t_s: float, box_xywh: Array) -> None:
        """Keep the last two answers."""
        self._answers = [*self._answers[-1:], (t_s, box_xywh)]

    def predict(self, t_s: float) -> Array:
        """Linear extrapolation; sides stay positive."""
        newest_s, newest = self._answers[-1]
        if len(self._answers) < 2:
            return newest
        before_s, before = self._answers[0]
        box = newest + (newest - before) * ((t_s - newest_s) / (newest_s - before_s))
        box[2:] = np.maximum(box[2:], 1.0)
        return box


@dataclass(frozen=True, slots=True)
class LatencyConfig:
    """fps: rate at which frames arrive, None: the sequence's own. slower: factor on the measured times.

    predictor: makes a fresh predictor for each sequence.
    """

    fps: float | None = None
    slower: float = 1.0
    predictor: Callable[[], Predictor] = ConstantVelocity


@dataclass(frozen=True, slots=True)
class Answer:
    """The box (4,) found in one frame, and when on the clock it was finished."""

    frame: int
    finished_s: float
    box_xywh: Array


@dataclass(frozen=True, slots=True)
class LateOutcome:
    """Boxes (N,4) that existed at each frame's time, without and with prediction, their scores.

    skipped: share of frames that the tracker never saw because it was busy.
    """

    boxes_xywh: Array
    predicted_xywh: Array
    score: Score
    predicted_score: Score
    skipped: float
    fps: float


def replay(look: Callable[[int], tuple[Array, float]], count: int, fps: float) -> list[Answer]:
    """Answers in order. look: processes a frame (0 first, rising), returns its box (4,) and the seconds it took."""
    answers: list[Answer] = []
    now_s, frame = 0.0, 0
    while frame < count:
        box, took_s = look(frame)
        now_s = max(now_s, frame / fps) + took_s
        answers.append(Answer(frame, now_s, box))
        # The newest that has arrived; where there is none yet, the next.
        frame = max(frame + 1, min(int((now_s + TINY_S) * fps), count - 1))
    return answers


def boxes_in_time(answers: list[Answer], count: int, fps: float, predictor: Predictor | None = None) -> Array:
    """(count,4): at each frame's time the newest finished answer, or what the predictor makes of those there are.

    Before the first answer is finished, the box that was given (answers[0]) is all there is.
    """
    boxes = np.empty((count, 4))
    known, next_answer = answers[0].box_xywh, 0
    for frame in range(count):
        t_s = frame / fps
        while next_answer < len(answers) and answers[next_answer].finished_s <= t_s + TINY_S:
            known = answers[next_answer].box_xywh
            if predictor is not None:
                predictor.observe(answers[next_answer].frame / fps, known)
            next_answer += 1
        boxes[frame] = predictor.predict(t_s) if predictor is not None and next_answer else known
    return boxes


def track_late(
    make_tracker: Callable[[], Tracker], sequence: Sequence, offline_xywh: Array, times_s: Array, config: LatencyConfig
) -> LateOutcome:
    """Latency-aware outcome. offline_xywh (N,4), times_s (N,): of the pass over every frame.

    Where those times skip no frame the tracker would see the very same frames: its boxes are used again.
    """
    fps, count = config.fps or sequence.fps, len(sequence)
    # The first look of all (init) is paid before the clock starts: an operator selects on a running station.
    answers = replay(lambda k: (offline_xywh[k], float(times_s[k]) * config.slower * (k > 0)), count, fps)
    if len(answers) < count:
        answers = replay(_Eyes(make_tracker(), sequence, config.slower).look, count, fps)
    plain = boxes_in_time(answers, count, fps)
    predicted = boxes_in_time(answers, count, fps, config.predictor())
    truth = sequence.truth_xywh
    skipped = 1 - len(answers) / count
    return LateOutcome(plain, predicted, score(plain, truth), score(predicted, truth), skipped, fps)


class _Eyes:
    """A tracker that looks at some of a sequence's frames, timed."""

    def __init__(self, tracker: Tracker, sequence: Sequence, slower: float) -> None:
        self._tracker, self._sequence, self._slower = tracker, sequence, slower
        self._images: Iterator[tuple[int, NDArray[np.uint8]]] = enumerate(sequence.images())

    def look(self, frame: int) -> tuple[Array, float]:
        image = next(image for at, image in self._images if at == frame)
        if frame == 0:
            first = Box.from_xywh(*(float(v) for v in self._sequence.truth_xywh[0]))
            self._tracker.init(image, first)
            return np.array(first.xywh), 0.0
        began = time.perf_counter()
        box = self._tracker.update(image).box.xywh
        return np.array(box), (time.perf_counter() - began) * self._slower

"""How sure an answer is: the network's score and the filter's response against the track's own past."""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from typing import ClassVar

from tracker.confidence import ConfidenceModel

REFERENCE_FRAMES = 10
HEARD_MEMORY = 0.9  # of the usual response, per frame in which the target is seen
HEARD_RANGE = (0.0, 2.0)
MIN_USUAL_HEARD = 0.1  # a filter that never heard more than this tells nothing by hearing less


class RelativeScore:
    """Brings the unbounded score to the scale of the track's own beginning.

    score / median of the first ten positive scores: 1 says as sure as at the start, 0.5 half as sure. A score
    of zero or less, which no cell of a good match has, is 0.
    """

    def __init__(self) -> None:
        self._first_scores: list[float] = []
        self._reference = 0.0

    def update(self, score: float) -> float:
        """Relative score, 0 or more, of this frame's score."""
        if not score > 0:
            return 0.0
        if len(self._first_scores) < REFERENCE_FRAMES:
            self._first_scores.append(score)
            self._reference = statistics.median(self._first_scores)
        return score / self._reference


@dataclass(frozen=True, slots=True)
class Evidence:
    """What one frame's answer is judged by.

    relative_score: score over its median at the track's beginning. heard: response of the correlation filter at
    the box; heard_ratio: that over what it was lately; 0 and 1 without a filter. Likeness to the first frame is
    no evidence: over a flight the right target loses it.
    """

    relative_score: float
    heard: float
    heard_ratio: float

    NAMES: ClassVar[tuple[str, ...]] = ("relative_score", "heard")

    @property
    def values(self) -> tuple[float, ...]:
        """What a confidence is fitted to, in the order of NAMES; the ratio would tell nothing more."""
        return (self.relative_score, self.heard)


class Judge:
    """Gathers the evidence of a track, frame by frame."""

    def __init__(self, model: ConfidenceModel | None) -> None:
        """model: from evidence to the probability that the box is right; None: the relative score, at most 1."""
        self._model = model
        self._relative = RelativeScore()
        self._usual_heard: float | None = None

    def judge(self, score: float, heard: float | None) -> Evidence:
        """Evidence of a frame's best score and the filter's response at the box (None without a filter)."""
        relative = self._relative.update(score)
        if heard is None:
            return Evidence(relative, 0.0, 1.0)
        if self._usual_heard is None:
            self._usual_heard = max(heard, MIN_USUAL_HEARD)
        ratio = min(max(heard / self._usual_heard, HEARD_RANGE[0]), HEARD_RANGE[1])
        return Evidence(relative, heard, ratio)

    def confidence(self, evidence: Evidence) -> float:
        """0..1, of what was judged."""
        if self._model is None:
            return min(1.0, evidence.relative_score)
        return self._model.probability(evidence.values)

    def forget(self) -> None:
        """The filter is another one from now on: what it usually says is not known."""
        self._usual_heard = None

    def seen(self, evidence: Evidence) -> None:
        """The target was seen in this frame: its response is a usual one."""
        if self._usual_heard is not None:
            usual = HEARD_MEMORY * self._usual_heard + (1 - HEARD_MEMORY) * evidence.heard
            self._usual_heard = max(usual, MIN_USUAL_HEARD)

"""What a search for a lost target finds, and the bounds and thresholds it keeps to."""

from __future__ import annotations

from dataclasses import dataclass

from tracker.box import Box


@dataclass(frozen=True, slots=True)
class RedetectConfig:
    """Bounds and thresholds of re-detection.

    windows_per_frame: search windows looked at in a frame, one network pass each.
    peaks_per_window: candidates taken from each, one template pass each.
    recheck_above: log-odds from which a candidate is looked at again in the next frame.
    believe_above, looks: mean log-odds, in so many frames in a row at the least, from which it is believed.
    believe_in_time: the same after four looks.
    resembling: log-odds from which a doubtful box is still taken for the target; others of its kind reach about 0.
    recent_margin: log-odds that likeness to a later view of the target counts less than to the first one.
    distractor_margin: a candidate must be this much more like the target than like any known distractor.
    most_for_recent: log-odds that a candidate gains where the target should be, just after it was lost.
    most_for_place: log-odds that a candidate loses at most for being far from where the target should be.
    near_wide, wide: how much larger than the tracker's own the windows are that look where the target is
    expected, and in the rest of the frame.
    """

    windows_per_frame: int = 2
    peaks_per_window: int = 2
    recheck_above: float = -1.5
    believe_above: float = 1.2
    looks: int = 2
    believe_in_time: float = 0.6
    resembling: float = 0.2
    recent_margin: float = 0.5
    distractor_margin: float = 0.0
    most_for_recent: float = 0.25
    most_for_place: float = 1.0
    near_wide: float = 1.0
    wide: float = 2.0


@dataclass(frozen=True, slots=True)
class Candidate:
    """Something that may be the target.

    box: frame px. score: the network's. log_odds: that it is the target, from score and appearance. likeness:
    mean, to the view of the target most alike; distractor_likeness: to the most alike distractor, -1 if none
    is known. looks: frames in a row in which it was likelier the target than not, and no distractor;
    mean_log_odds: over these.
    """

    box: Box
    score: float
    log_odds: float
    likeness: float
    distractor_likeness: float
    looks: int = 0
    mean_log_odds: float = 0.0


@dataclass(frozen=True, slots=True)
class Redetection:
    """One frame's findings: candidates, likeliest first, and the one that is believed to be the target, or None."""

    candidates: tuple[Candidate, ...]
    believed: Candidate | None

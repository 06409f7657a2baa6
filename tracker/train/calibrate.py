"""From a tracker's evidence to a probability: fitted on held-out clips, kept in the weights' manifest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tracker.box import TrackResult
from tracker.evidence import Evidence
from tracker.online import ClimRTTracker
from tracker.train.clips import TruthClip, tracked_clips
from tracker.train.pack import Imagery
from tracker.train.rehearsal import COMPOSED, composed_clip, hidden_for_a_while, observe
from tracker.train.reliability import Reliability, draw, fit
from tracker.weights import amend, load_network, read_manifest

COMPOSED_CLIPS = 60
REAL_WEIGHT = 5  # frames that were filmed count more than composed ones, of which there are as many as wanted
CLIP_FRAMES = 40


def calibrate(weights: Path, held_out: Imagery, say: Callable[[str], None], *, seed: int = 1) -> Reliability:
    """Fit P(IoU > 0.5) to tracks over held-out clips; writes it into the manifest and a curve beside it.

    Every clip is tracked as it is, and once more with its target hidden for a while; composed clips, with
    rivals and things that the target goes behind, are added. Raises WeightsError and ReliabilityError.
    """
    config = read_manifest(weights).tracker
    # Never taken for hidden: what is judged is every single answer, right or wrong.
    open_config = replace(config, lost_below=0.0, doubt_below=0.0)
    tracker = ClimRTTracker(load_network(weights), open_config)
    clips = rehearsal_clips(held_out, seed)
    seen = observe(tracker, clips, evidence_of(tracker))
    rows = np.repeat(np.arange(len(seen.good)), [REAL_WEIGHT if is_real(g) else 1 for g in seen.groups])
    found = fit(seen.features[rows], seen.good[rows], seen.groups[rows], Evidence.NAMES)
    amend(weights, {"confidence": found.to_dict()})
    picture = draw(found, weights.with_name(f"{weights.stem}-reliability.png"))
    say(
        f"{found.observations} frames of {found.groups} clips, {found.good_frac:.0%} right: "
        f"expected calibration error {found.ece:.3f}, ranking {found.auc:.3f}; curve in {picture}"
    )
    return found


def rehearsal_clips(held_out: Imagery, seed: int) -> list[TruthClip]:
    """Held-out clips as they are and with a hidden stretch, and composed ones."""
    rng = np.random.default_rng(seed)
    clips = tracked_clips(held_out, most=20, longest=CLIP_FRAMES)
    sceneries = [held_out.pyramids[i][1] for i in rng.integers(len(held_out), size=len(clips))]
    hidden = [hidden_for_a_while(c, s, rng) for c, s in zip(clips, sceneries, strict=True)]
    return clips + hidden + [composed_clip(held_out, seed * 1000 + i) for i in range(COMPOSED_CLIPS)]


def is_real(group: str) -> bool:
    """Whether the clip of this name was filmed, not composed."""
    return not group.startswith(COMPOSED)


def evidence_of(tracker: ClimRTTracker) -> Callable[[TrackResult], Sequence[float]]:
    """What the tracker judged its last answer by."""

    def features(_: TrackResult) -> Sequence[float]:
        assert tracker.evidence is not None
        return tracker.evidence.values

    return features

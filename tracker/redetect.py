"""Finding a lost target again: a bounded number of search windows per frame, and proof before belief."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np

from tracker.appearance import Appearance, CueWeights, Describer, Distractors, likeness
from tracker.box import Box
from tracker.candidates import Candidate, RedetectConfig, Redetection
from tracker.configs import TrackerConfig
from tracker.crop import Colour, Image, context_side_px, mean_colour
from tracker.decode import Calibration, Decoded, decode
from tracker.engines.engine import Engine
from tracker.motion import Homography, carry
from tracker.network.climrt import Features
from tracker.search_map import DRIFT_PER_FRAME, START_SPREAD, SearchMap

PEAK_SPACING = 0.8  # of the box's sides, between two peaks in one window
RECENT_VIEWS = 3
ZOOMS = (1.5, 1.0, 0.65, 1.0)  # parts of its last size in which a target is looked for, one after the other
RECENT_FRAMES = 10  # in which what is known of the moment of loss fades
ASIDE_FRAMES = 8
PATIENCE = 4  # looks in a row at a candidate that may be the target and does not prove it
SIDES = ((1, 0), (-1, 0), (0, 1), (0, -1))
SAME_PLACE = 0.7  # mean sides a candidate may move over the ground between two looks
DISTRACTOR_SCORE = 0.3  # of the target's own first score: what scores less is no danger
MIN_REFERENCE = 0.05  # a first score below says that the network does not know the target at all


class Redetector:
    """Looks for a lost target over the whole frame, with the tracker's own network.

    `remember` now and then while the target is seen for sure; `start` when it is lost, then `search` in each
    frame until that returns something believed. A frame costs at most windows_per_frame passes over search
    patches, and peaks_per_window passes over template patches for each of them. They look again at the last
    candidate, where the target is expected, and over the rest of the frame.
    """

    def __init__(
        self,
        engine: Engine,
        tracker: TrackerConfig,
        frame_bgr: Image,
        box: Box,
        template: Features,
        *,
        calibration: Calibration | None = None,
        config: RedetectConfig | None = None,
        weights: CueWeights | None = None,
    ) -> None:
        """For the target in this box of its first frame; template, calibration: the tracker's."""
        self.config, self._weights = config or RedetectConfig(), weights or CueWeights()
        self._engine, self._tracker, self._template = engine, replace(tracker, window_influence=0.0), template
        self._calibration = calibration
        self._fill: Colour = mean_colour(frame_bgr)
        self._describer = Describer(engine, tracker, frame_bgr, box)
        self._first = self._describer.describe(frame_bgr, box)
        self._recent: deque[Appearance] = deque(maxlen=RECENT_VIEWS)
        self._distractors = Distractors()
        self._map: SearchMap | None = None
        self._tentative: Candidate | None = None
        self._told_px: tuple[float, float] | None = None
        self._turn = self._lost_frames = self._near_looks = 0
        self._aside: tuple[Box, int] | None = None  # what did not prove itself, and for how many frames more
        self._size = box
        self._reference = max(MIN_REFERENCE, self._look(frame_bgr, box).score)

    def remember(self, frame_bgr: Image, box: Box) -> None:
        """Keep how the target looks, in this box for sure, and what else round it might be taken for it.

        Costs one window and a few template passes: for one frame in ten or so.
        """
        self._size = box
        view = self._describer.describe(frame_bgr, box)
        if self._weights.log_odds(1.0, likeness(self._first, view)) > 0:  # a view that is no longer it must not count
            self._recent.append(view)
        # Beside the target, on one side after the other: with the target in view the network heeds nothing else.
        turn, self._turn = self._turn, (self._turn + 1) % len(SIDES)
        away_px = self._tracker.search_px / self._scale(box) / 2 + max(box.w_px, box.h_px) / 2
        centre = replace(box, cx_px=box.cx_px + SIDES[turn][0] * away_px, cy_px=box.cy_px + SIDES[turn][1] * away_px)
        decoded = self._look(frame_bgr, centre)
        for found, score in islice(self._peaks(decoded, centre), self.config.peaks_per_window):
            is_target = abs(found.cx_px - box.cx_px) < box.w_px and abs(found.cy_px - box.cy_px) < box.h_px
            if score > DISTRACTOR_SCORE * self._reference and not is_target:
                self._distractors.add(self._describer.describe(frame_bgr, found))

    def resembles(self, frame_bgr: Image, box: Box, score: float) -> bool:
        """Whether what is at this place looks rather like the target, now or of late, than like anything else."""
        judged = self._judged(frame_bgr, self._at(box.cx_px, box.cy_px), score)
        return judged.log_odds > self.config.resembling and judged.likeness > judged.distractor_likeness

    def expect(self, cx_px: float, cy_px: float) -> None:
        """Somebody who knows better says where the target will be in the next frame (centre, px)."""
        self._told_px = (cx_px, cy_px)

    def start(self, frame_bgr: Image, expected: Box) -> None:
        """The target is lost, with this size, and expected here."""
        height, width = frame_bgr.shape[:2]
        self._size, self._tentative, self._told_px, self._lost_frames = expected, None, None, 0
        self._near_looks, self._aside = 0, None
        self._map = SearchMap((width, height), expected.cx_px, expected.cy_px, _side(expected))

    def search(
        self,
        frame_bgr: Image,
        motion: Homography | None = None,
        velocity_px: tuple[float, float] = (0.0, 0.0),
        expected_px: tuple[float, float] | None = None,
    ) -> Redetection:
        """Look into the next frame.

        motion: of the background since the last frame; velocity_px: of the target over the ground, px per
        frame. expected_px: where the target should be in this frame; None where that is not known, or looked
        at by somebody else. Raises ValueError before `start`.
        """
        if self._map is None:
            raise ValueError("search before start: say first where the target was lost")
        self._map.move(motion, velocity_px)
        self._lost_frames += 1
        self._move_aside(motion)
        again = self._carried(motion)
        found: list[Candidate] = []
        for place, wide in islice(self._places(self._map, again, expected_px), self.config.windows_per_frame):
            found += self._window(frame_bgr, self._map, place, wide)
        if expected_px is not None:
            found = [self._weighed(c, expected_px) for c in found]
        found = [self._followed(c, again) for c in sorted(found, key=lambda c: c.log_odds, reverse=True)]
        # From a wide window place and likeness are rough: worth a second look, but not for ever.
        worth_it = (c for c in found if c.log_odds > self.config.recheck_above and not self._is_aside(c))
        self._tentative = next((c for c in worth_it if not self._is_settled(c, again)), None)
        if self._aside is None:
            tried = next((c for c in found if c.looks >= PATIENCE), None)
            self._aside = (tried.box, ASIDE_FRAMES) if tried is not None else None
        return Redetection(tuple(found), next((c for c in found if self._is_proved(c)), None))

    def _is_aside(self, candidate: Candidate) -> bool:
        """Whether it was looked at often of late and did not prove itself: others have their turn first."""
        return self._aside is not None and self._is_same(candidate, self._aside[0])

    def _move_aside(self, motion: Homography | None) -> None:
        if self._aside is not None:
            box, frames = self._aside
            box = carry(box, motion) if motion is not None else box
            self._aside = (box, frames - 1) if frames > 1 else None

    def _places(
        self, places: SearchMap, again: Box | None, expected_px: tuple[float, float] | None
    ) -> Iterator[tuple[Box, float]]:
        """Where, and in which size, to look for it in this frame, and how wide, the most urgent first."""
        told_px, self._told_px = self._told_px, None
        if again is not None:
            yield self._at(again.cx_px, again.cy_px, again.w_px / self._size.w_px), 1.0
        first = told_px or expected_px
        # In every other frame at the latest, however much there is to look at here, the rest gets its turn.
        if first is not None and (told_px is not None or again is None or self._lost_frames % 2):
            self._near_looks += 1
            yield self._at(*first, ZOOMS[self._near_looks % len(ZOOMS)]), self.config.near_wide
        wide = self.config.wide
        while True:
            yield self._at(*places.best(self._reach_px(self._size, wide))), wide

    def _at(self, cx_px: float, cy_px: float, zoom: float = 1.0) -> Box:
        """The target at this place, at `zoom` times the size last known."""
        return Box(cx_px, cy_px, self._size.w_px * zoom, self._size.h_px * zoom)

    def _is_same(self, candidate: Candidate, before: Box | None) -> bool:
        if before is None:
            return False
        away_px = math.hypot(candidate.box.cx_px - before.cx_px, candidate.box.cy_px - before.cy_px)
        return away_px <= SAME_PLACE * _side(self._size)

    def _is_settled(self, candidate: Candidate, before: Box | None) -> bool:
        return self._is_same(candidate, before) and not 0 < candidate.looks < PATIENCE

    def _is_proved(self, candidate: Candidate) -> bool:
        enough = self.config.believe_in_time if candidate.looks >= PATIENCE else self.config.believe_above
        return candidate.looks >= self.config.looks and candidate.mean_log_odds > enough

    def _carried(self, motion: Homography | None) -> Box | None:
        """Where the last frame's candidate should be now."""
        if self._tentative is None or motion is None:
            return self._tentative.box if self._tentative is not None else None
        return carry(self._tentative.box, motion)

    def _reach_px(self, size: Box, wide: float) -> float:
        """Side of the square (frame px) in which one window finds the centre of a target of this size."""
        config = self._tracker
        return wide * config.grid_cells * config.grid_stride_px / self._scale(size)

    def _scale(self, size: Box) -> float:
        """Patch px per frame px in the tracker's own window for a target of this size."""
        return self._tracker.exemplar_px / context_side_px(size.w_px, size.h_px, self._tracker.context_frac)

    def _window(self, frame_bgr: Image, places: SearchMap, place: Box, wide: float) -> list[Candidate]:
        """Candidates round this place, of the box's size: a place is believed sooner than the network's size."""
        decoded = self._look(frame_bgr, place, wide)
        places.looked(place.cx_px, place.cy_px, self._reach_px(place, wide))
        peaks = islice(self._peaks(decoded, place, wide), self.config.peaks_per_window)
        return [self._judged(frame_bgr, box, score) for box, score in peaks]

    def _judged(self, frame_bgr: Image, box: Box, score: float) -> Candidate:
        """What is in this box, with this score of the network's, as a candidate. One template pass."""
        appearance, relative = self._describer.describe(frame_bgr, box), score / self._reference
        alike = likeness(self._first, appearance)
        log_odds, mean = self._weights.log_odds(relative, alike), alike.mean
        for view in self._recent:
            alike = likeness(view, appearance)
            log_odds = max(log_odds, self._weights.log_odds(relative, alike) - self.config.recent_margin)
            mean = max(mean, alike.mean)
        return Candidate(box, score, log_odds, mean, self._distractors.likeness(appearance))

    def _weighed(self, candidate: Candidate, expected_px: tuple[float, float]) -> Candidate:
        """Less likely the further it is from where the target should be, as far as that is still known.

        Likelier where it should be and was a moment ago: few things vanish.
        """
        away_px = math.hypot(candidate.box.cx_px - expected_px[0], candidate.box.cy_px - expected_px[1])
        sigma_px = (START_SPREAD + DRIFT_PER_FRAME * math.sqrt(self._lost_frames)) * _side(self._size)
        squared = 0.5 * (away_px / sigma_px) ** 2
        more = self.config.most_for_recent * math.exp(-self._lost_frames / RECENT_FRAMES - squared)
        return replace(candidate, log_odds=candidate.log_odds + more - min(squared, self.config.most_for_place))

    def _followed(self, candidate: Candidate, before: Box | None) -> Candidate:
        """The candidate with its good looks counted, on from the last frame's if it is at the same place."""
        is_like_another = candidate.distractor_likeness > candidate.likeness - self.config.distractor_margin
        if candidate.log_odds <= 0 or is_like_another:
            return candidate
        earlier, looks, mean = self._tentative, 1, candidate.log_odds
        if earlier is not None and self._is_same(candidate, before):
            looks = earlier.looks + 1
            mean = (earlier.mean_log_odds * earlier.looks + candidate.log_odds) / looks
        return replace(candidate, looks=looks, mean_log_odds=mean)

    def _look(self, frame_bgr: Image, place: Box, wide: float = 1.0) -> Decoded:
        """The network's word on the window round a target in this box, without the Hann window for its middle."""
        config = self._tracker
        scale = self._scale(place) / wide
        side_px = max(1, round(config.search_px / scale))
        patch = self._engine.cut(frame_bgr, place.cx_px, place.cy_px, side_px, config.search_px, self._fill)
        features = self._engine.embed(patch)
        # There is no earlier look at this place: the present stands for the latent frame.
        loc, cls1, cls2 = (m[0].float().cpu() for m in self._engine.compare(features, self._template, features[-1]))
        frame_wh_px = (frame_bgr.shape[1], frame_bgr.shape[0])
        return decode(loc, cls1, cls2, place, scale, frame_wh_px, config, self._calibration)

    def _peaks(self, decoded: Decoded, place: Box, wide: float = 1.0) -> Iterator[tuple[Box, float]]:
        """Places (frame px, of the size looked for) and scores of the window's peaks, highest rank first."""
        x, y, w, h = decoded.offsets_px * wide / self._scale(place)
        ranks = np.where(np.isfinite(decoded.ranks) & (w > 0) & (h > 0), decoded.ranks, -np.inf)
        while np.isfinite(ranks).any():
            i = int(np.argmax(ranks))
            found = replace(place, cx_px=place.cx_px + float(x[i]), cy_px=place.cy_px + float(y[i]))
            yield found, float(decoded.scores[i])
            near = np.hypot((x - x[i]) / place.w_px, (y - y[i]) / place.h_px) < PEAK_SPACING
            ranks = np.where(near, -np.inf, ranks)


def _side(box: Box) -> float:
    return (box.w_px + box.h_px) / 2

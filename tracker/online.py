"""Following one object through the frames of a video, one frame at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import NamedTuple

import torch
from torch import Tensor

from tracker.box import Box, TrackResult
from tracker.confidence import ConfidenceModel, logistic
from tracker.configs import TrackerConfig
from tracker.correlation_filter import CorrelationFilter, FilterConfig
from tracker.crop import Colour, Image, check_box, check_frame, context_side_px, mean_colour
from tracker.decode import Calibration, Decoded, decode
from tracker.engines.eager import as_engine
from tracker.engines.engine import Engine, Patch
from tracker.evidence import Evidence, Judge
from tracker.latent import latent_source
from tracker.network.climrt import ClimRT, Features
from tracker.recovery import DOUBTFUL_FRAMES, Recovery

MIN_INIT_SIDE_PX = 4.0
# A first guess further off than this is no bias but a miss.
GAIN_RANGE = (0.5, 2.0)
MAX_OFFSET_PX = 12.0
REACH_PER_FRAME = 0.1  # mean sides of the box
CLEARLY_HEARD = 0.6  # of the filter's usual response: such a target is not lost, whatever the network says
REFOUND_FRAMES = 20  # for how many the frame counts in which the object was found again
FILTERED = -2  # layer 4 among the backbone's features, which end with layers 4 and 5
LEARN_EVERY = 5  # frames between two lessons of the correlation filter


@dataclass(frozen=True, slots=True)
class Loaded:
    """What a tracker was loaded from, and what runs it: weights by name or path, their SHA-256, engine, CPU threads."""

    weights: str
    sha256: str
    engine: str
    threads: int


class NotInitialisedError(ValueError):
    """update was called before init."""


class _Lesson(NamedTuple):
    frame_bgr: Image
    decoded: Decoded
    confidence: float


class Sight(Enum):
    """What a frame shows of the object."""

    SEEN = auto()
    DOUBTFUL = auto()
    HIDDEN = auto()


class ClimRTTracker:
    """The online tracker: template of the first frame, search patch round the last box.

    What else it does (correlation filter, re-detection) is as its TrackerConfig says. Give init a frame and a
    box, then each following frame to update. Not for several threads at once.
    """

    def __init__(
        self,
        network: ClimRT | Engine,
        config: TrackerConfig,
        *,
        confidence: ConfidenceModel | None = None,
        threads: int | None = None,
    ) -> None:
        """network: as trained, for the reference engine; or an engine.

        confidence: from evidence to probability, None: relative to the track's beginning.
        threads: CPU threads for PyTorch, in the whole process; None leaves them as they are.
        """
        if threads is not None:
            torch.set_num_threads(threads)
        self.config = config
        self.loaded: Loaded | None = None  # by tracker.weights.load_tracker
        self._engine = as_engine(network)
        self._latent = latent_source(self._engine, config)
        self._model = confidence
        self._judge = Judge(confidence)
        self._template: Features | None = None
        self._box = Box(0.0, 0.0, 0.0, 0.0)
        self._first_side_px = 0
        self._frames = 0
        self._hidden_frames = 0
        self._doubtful_frames = 0
        self._is_refound = False
        self._fill: Colour = (0, 0, 0)
        self._calibration: Calibration | None = None
        self._filter: CorrelationFilter | None = None
        self._reduced: Tensor | None = None
        self._recovery: Recovery | None = None
        self._lesson: _Lesson | None = None
        self.evidence: Evidence | None = None

    def init(self, frame_bgr: Image, box: Box) -> None:
        """Take the object in the box (frame px) of this (H, W, 3) uint8 frame as the one to follow.

        Raises ValueError, with the figures, for a box that is empty, tiny or outside, and for a bad frame;
        an earlier track then goes on undisturbed.
        """
        check_frame(frame_bgr)
        check_box(box, frame_bgr, MIN_INIT_SIDE_PX)
        config = self.config
        side_px = round(context_side_px(box.w_px, box.h_px, config.context_frac))
        fill = mean_colour(frame_bgr)
        patch = self._engine.cut(frame_bgr, box.cx_px, box.cy_px, side_px, config.exemplar_px, fill)
        self._template = self._engine.embed(patch)
        self._box, self._first_side_px, self._fill = box, side_px, fill
        self._judge, self.evidence = Judge(self._model), None
        self._frames = self._hidden_frames = self._doubtful_frames = 0
        self._is_refound = False
        self._filter = self._learned(frame_bgr) if config.has_filter else None
        self._calibration = self._calibrated(frame_bgr, self._template) if config.calibrate else None
        self._recovery = None
        if config.redetect:
            self._recovery = Recovery(self._engine, config, frame_bgr, box, self._template, self._calibration)
        self._latent.reset()
        self._lesson = None

    def _learned(self, frame_bgr: Image) -> CorrelationFilter:
        """A filter that knows the target and its surroundings in the first frame."""
        with torch.inference_mode():
            features = self._engine.embed(self._search_patch(frame_bgr)[0])
            return CorrelationFilter(features[FILTERED], FilterConfig())

    def _calibrated(self, frame_bgr: Image, template: Features) -> Calibration | None:
        """What makes the network's box of the object in its own first frame the box that was given.

        A network that has learned sizes and edges imperfectly errs alike on the same object again and again,
        and each error would shift and scale the next search patch: the box would creep and grow without end.
        """
        self._calibration = None
        self._latent.reset()
        decoded = self._step(frame_bgr, template)
        if decoded.best is None:
            return None
        x_px, y_px, w_px, h_px = (float(v) for v in decoded.offsets_px[:, decoded.best])
        scale = self.config.exemplar_px / self._template_side_px(frame_bgr.shape[0] * frame_bgr.shape[1])
        w_gain, h_gain = self._box.w_px * scale / w_px, self._box.h_px * scale / h_px
        return Calibration(
            (_between(w_gain, *GAIN_RANGE), _between(h_gain, *GAIN_RANGE)),
            (_between(x_px, -MAX_OFFSET_PX, MAX_OFFSET_PX), _between(y_px, -MAX_OFFSET_PX, MAX_OFFSET_PX)),
        )

    def update(self, frame_bgr: Image) -> TrackResult:
        """The object's box in the next frame. Raises NotInitialisedError, or ValueError for a bad frame.

        The frame's pixels are read once more by `learn`: they must stay as they are until then.
        """
        check_frame(frame_bgr)
        if self._template is None:
            raise NotInitialisedError("update before init: give init a frame and a box first")
        self.learn()
        self._frames += 1
        if self._recovery is not None and self._hidden_frames:
            return self._searched(frame_bgr, self._recovery)
        decoded = self._step(frame_bgr, self._template)
        evidence = self._judge.judge(decoded.score, decoded.heard if self._filter is not None else None)
        self.evidence, confidence = evidence, self._judge.confidence(evidence)
        sight = self._sight(frame_bgr, decoded, evidence)
        self._hidden_frames = self._hidden_frames + 1 if sight is Sight.HIDDEN else 0
        if sight is Sight.HIDDEN and self._recovery is not None:
            self._recovery.lose(frame_bgr)
            return self._searched(frame_bgr, self._recovery, decoded.score, confidence)
        self._box = decoded.box
        if sight is Sight.SEEN:
            self._judge.seen(evidence)
            self._lesson = _Lesson(frame_bgr, decoded, confidence)
        elif self._recovery is not None:
            self._recovery.doubted(frame_bgr)
        return TrackResult(decoded.box, decoded.score, confidence, visible=sight is Sight.SEEN)

    def _sight(self, frame_bgr: Image, decoded: Decoded, evidence: Evidence) -> Sight:
        """Whether the object is there: hidden if score and filter say so, doubtful if the filter alone does."""
        is_unheard = self._filter is None or evidence.heard_ratio < CLEARLY_HEARD
        if is_unheard and self._is_hidden(decoded.box, min(1.0, evidence.relative_score)):
            self._doubtful_frames = 0
            return Sight.HIDDEN
        if evidence.heard_ratio >= self.config.doubt_below:
            self._doubtful_frames = 0
            return Sight.SEEN
        self._doubtful_frames += 1
        if self._recovery is None or self._doubtful_frames < DOUBTFUL_FRAMES:
            return Sight.SEEN if self._is_refound else Sight.DOUBTFUL
        self._doubtful_frames = 0
        # The filter may just not know this view of it yet.
        self._is_refound = self._recovery.resembles(frame_bgr, decoded.box, decoded.score)
        return Sight.SEEN if self._is_refound else Sight.HIDDEN

    def learn(self) -> None:
        """Filter and recovery learn from the last frame, if the target is in it for sure.

        Whoever has time before the next frame calls this then; otherwise the next update does, first of all. It may
        take longer than an update.
        """
        if self._lesson is None:
            return
        (frame_bgr, decoded, confidence), self._lesson = self._lesson, None
        surely = confidence >= self.config.sure_above
        if self._recovery is not None:
            self._recovery.seen(frame_bgr, decoded.box, surely=surely)
        if self._filter is None or self._reduced is None:
            return
        with torch.inference_mode():
            if self._is_refound:  # what it learned last may have been what hid the target
                self._filter.forget()
                self._filter.learn(self._reduced, decoded.centre_px, REFOUND_FRAMES)
            elif surely and self._frames % LEARN_EVERY == 0:
                self._filter.learn(self._reduced, decoded.centre_px, LEARN_EVERY)
        self._is_refound = False

    def _searched(
        self, frame_bgr: Image, recovery: Recovery, score: float = 0.0, confidence: float = 0.0
    ) -> TrackResult:
        """While the object is hidden: where it is expected, until something proves to be it."""
        found = recovery.search(frame_bgr)
        if found is None:
            self._hidden_frames += 1
            self._box = recovery.expected
            return TrackResult(self._box, score, min(confidence, self.config.lost_below), visible=False)
        self._box = found.box
        self._hidden_frames = 0
        self._latent.reset()
        self._judge.forget()
        self._is_refound = True
        recovery.seen(frame_bgr, self._box)
        return TrackResult(self._box, found.score, logistic(found.log_odds))

    def look_at(self, cx_px: float, cy_px: float) -> None:
        """While the object is hidden: where to look for it in the next frame (centre, frame px).

        Who knows how camera and object move knows better than the last guess; without it that one is used.
        """
        if not (self._hidden_frames and math.isfinite(cx_px) and math.isfinite(cy_px)):
            return
        self._box = replace(self._box, cx_px=cx_px, cy_px=cy_px)
        if self._recovery is not None:
            self._recovery.expect(cx_px, cy_px)

    def _is_hidden(self, found: Box, relative: float) -> bool:
        """Hysteresis in the relative score; what is believed to be back must lie near, less near as time goes by."""
        if not self._hidden_frames:
            return relative < self.config.lost_below
        reach_px = (1 + REACH_PER_FRAME * self._hidden_frames) * (self._box.w_px + self._box.h_px) / 2
        distance_px = math.hypot(found.cx_px - self._box.cx_px, found.cy_px - self._box.cy_px)
        return relative < self.config.found_above or distance_px > reach_px

    def _search_patch(self, frame_bgr: Image) -> tuple[Patch, float]:
        """The square that is searched, and patch px per frame px."""
        config = self.config
        template_side_px = self._template_side_px(frame_bgr.shape[0] * frame_bgr.shape[1])
        side_px = round(template_side_px * config.search_px / config.exemplar_px)
        patch = self._engine.cut(frame_bgr, self._box.cx_px, self._box.cy_px, side_px, config.search_px, self._fill)
        return patch, config.exemplar_px / template_side_px

    @torch.inference_mode()
    def _step(self, frame_bgr: Image, template: Features) -> Decoded:
        patch, scale = self._search_patch(frame_bgr)
        features = self._engine.embed(patch)  # (1, c4, 28, 28), (1, c5, 26, 26)
        latent5 = self._latent.latent5(patch, features[-1])  # (1, c5, 26, 26)
        predictions = self._engine.compare(features, template, latent5)
        response = None
        if self._filter is not None:
            self._reduced = self._filter.reduce(features[FILTERED])
            response = self._filter.response(self._reduced)
        # One transfer, the last thing asked for: each waits for the engine's device.
        maps = torch.cat(predictions, 1)[0].cpu()  # (7, 11, 11)
        loc, cls1, cls2 = torch.split(maps, [each.shape[1] for each in predictions])
        frame_wh_px = (frame_bgr.shape[1], frame_bgr.shape[0])
        return decode(loc, cls1, cls2, self._box, scale, frame_wh_px, self.config, self._calibration, response)

    def _template_side_px(self, frame_area: int) -> float:
        """Side of the square in the frame that corresponds to the template patch."""
        box = self._box
        if box.w_px * box.h_px > self.config.huge_frac * frame_area:
            return self._first_side_px
        return context_side_px(box.w_px, box.h_px, self.config.context_frac)


def _between(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)

"""Following one object through the frames of a video, one frame at a time."""

from __future__ import annotations

import math
import statistics
from dataclasses import replace

import torch
from torch import Tensor

from tracker.box import Box, TrackResult
from tracker.configs import TrackerConfig
from tracker.crop import Colour, Image, check_box, check_frame, context_side_px, crop, mean_colour
from tracker.decode import Calibration, Decoded, decode
from tracker.latent import latent_source
from tracker.network.climrt import ClimRT, Features
from tracker.network.inference import for_inference

MIN_INIT_SIDE_PX = 4.0
REFERENCE_FRAMES = 10
# A first guess further off than this is no bias but a miss.
GAIN_RANGE = (0.5, 2.0)
MAX_OFFSET_PX = 12.0
REACH_PER_FRAME = 0.1  # mean sides of the box


class NotInitialisedError(ValueError):
    """update was called before init."""


class Confidence:
    """Brings the unbounded score to 0..1, relative to the track's own beginning.

    confidence = score / median of the first ten positive scores, clipped to 0..1: 1 says as sure as at the
    start, 0.5 half as sure. A score of zero or less, which no cell of a good match has, is 0.
    """

    def __init__(self) -> None:
        self._first_scores: list[float] = []

    def update(self, score: float) -> float:
        """Confidence, 0..1, of this frame's score."""
        if not score > 0:
            return 0.0
        if len(self._first_scores) < REFERENCE_FRAMES:
            self._first_scores.append(score)
        return min(1.0, score / statistics.median(self._first_scores))


class ClimRTTracker:
    """The online tracker: template of the first frame, search patch round the last box, never re-detects.

    Give init a frame and a box, then each following frame to update. Not for several threads at once.
    """

    def __init__(self, network: ClimRT, config: TrackerConfig, *, threads: int | None = None) -> None:
        """threads: CPU threads for PyTorch, in the whole process; None leaves them as they are."""
        if threads is not None:
            torch.set_num_threads(threads)
        self.config = config
        self._network = for_inference(network)
        self._device = next(network.parameters()).device
        self._latent = latent_source(self._network, config)
        self._template: Features | None = None
        self._box = Box(0.0, 0.0, 0.0, 0.0)
        self._first_side_px = 0
        self._hidden_frames = 0
        self._fill: Colour = (0, 0, 0)
        self._confidence = Confidence()
        self._calibration: Calibration | None = None

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
        patch = crop(frame_bgr, box.cx_px, box.cy_px, side_px, config.exemplar_px, fill)
        with torch.inference_mode():
            self._template = self._network.template(self._tensor(patch))
        self._box, self._first_side_px, self._fill = box, side_px, fill
        self._confidence, self._hidden_frames = Confidence(), 0
        self._calibration = self._calibrated(frame_bgr, self._template) if config.calibrate else None
        self._latent.reset()

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
        """The object's box in the next frame. Raises NotInitialisedError, or ValueError for a bad frame."""
        check_frame(frame_bgr)
        if self._template is None:
            raise NotInitialisedError("update before init: give init a frame and a box first")
        decoded = self._step(frame_bgr, self._template)
        confidence = self._confidence.update(decoded.score)
        is_hidden = self._is_hidden(decoded.box, confidence)
        self._hidden_frames = self._hidden_frames + 1 if is_hidden else 0
        self._box = decoded.box
        return TrackResult(decoded.box, decoded.score, confidence, visible=not is_hidden)

    def look_at(self, cx_px: float, cy_px: float) -> None:
        """While the object is hidden: where to look for it in the next frame (centre, frame px).

        Who knows how camera and object move knows better than the last guess; without it that one is used.
        """
        if self._hidden_frames and math.isfinite(cx_px) and math.isfinite(cy_px):
            self._box = replace(self._box, cx_px=cx_px, cy_px=cy_px)

    def _is_hidden(self, found: Box, confidence: float) -> bool:
        """Hysteresis in confidence; what is believed to be back must lie near, less near as time goes by."""
        if not self._hidden_frames:
            return confidence < self.config.lost_below
        reach_px = (1 + REACH_PER_FRAME * self._hidden_frames) * (self._box.w_px + self._box.h_px) / 2
        distance_px = math.hypot(found.cx_px - self._box.cx_px, found.cy_px - self._box.cy_px)
        return confidence < self.config.found_above or distance_px > reach_px

    def _step(self, frame_bgr: Image, template: Features) -> Decoded:
        config = self.config
        frame_h, frame_w = frame_bgr.shape[:2]
        template_side_px = self._template_side_px(frame_w * frame_h)
        scale = config.exemplar_px / template_side_px
        side_px = round(template_side_px * config.search_px / config.exemplar_px)
        patch = crop(frame_bgr, self._box.cx_px, self._box.cy_px, side_px, config.search_px, self._fill)
        loc, cls1, cls2 = self._predict(self._tensor(patch), template)
        return decode(loc, cls1, cls2, self._box, scale, (frame_w, frame_h), config, self._calibration)

    def _template_side_px(self, frame_area: int) -> float:
        """Side of the square in the frame that corresponds to the template patch."""
        box = self._box
        if box.w_px * box.h_px > self.config.huge_frac * frame_area:
            return self._first_side_px
        return context_side_px(box.w_px, box.h_px, self.config.context_frac)

    @torch.inference_mode()
    def _predict(self, patch: Tensor, template: Features) -> list[Tensor]:
        features = self._network.features(patch)  # (1, c4, 28, 28), (1, c5, 26, 26)
        latent5 = self._latent.latent5(patch, features[-1])  # (1, c5, 26, 26)
        return [maps[0].cpu() for maps in self._network.heads(features, template, latent5)]

    def _tensor(self, patch: Image) -> Tensor:
        """(S, S, 3) uint8 to (1, 3, S, S) float 0..255; stays channels-last in memory, as the network's."""
        return torch.from_numpy(patch).to(self._device).permute(2, 0, 1)[None].float()


def _between(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)

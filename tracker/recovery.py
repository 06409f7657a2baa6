"""Losing the target and finding it again: where it should be, and where to look for it."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import NamedTuple

from tracker.box import Box
from tracker.candidates import Candidate
from tracker.configs import TrackerConfig
from tracker.crop import Image
from tracker.decode import Calibration
from tracker.engines.engine import Engine
from tracker.motion import PATH_FRAMES, Grey, StabilisedPath, background_motion, small_grey
from tracker.network.climrt import Features
from tracker.redetect import Redetector

DOUBTFUL_FRAMES = 3  # in a row, after which the target is looked for elsewhere
REMEMBER_EVERY = 10  # frames between two looks at what else is like the target


class Moment(NamedTuple):
    """A recent frame: grey and small, small px per frame px; the target's box where it was seen for sure, and where
    it is as far as is known (frame px)."""

    grey: Grey
    scale: float
    seen: Box | None
    box: Box


class Recovery:
    """Keeps of a track what is needed once the target is lost, and then looks for it.

    `seen` in each frame with the target; `lose` in the first without; then `search` in that frame and the
    following ones, until it returns something believed.
    The camera's motion is worked out only when the target is lost: then for the last frames at once.
    """

    def __init__(
        self,
        engine: Engine,
        config: TrackerConfig,
        frame_bgr: Image,
        box: Box,
        template: Features,
        calibration: Calibration | None,
    ) -> None:
        self._redetector = Redetector(engine, config, frame_bgr, box, template, calibration=calibration)
        self._recent: deque[Moment] = deque(maxlen=PATH_FRAMES + DOUBTFUL_FRAMES)
        self._path = StabilisedPath()
        self._size = box
        self._seen_frames = 0
        self.seen(frame_bgr, box, surely=True)

    def seen(self, frame_bgr: Image, box: Box, *, surely: bool = False) -> None:
        """The target is in this box; surely: so that its way, and what is beside it, can be learned from it."""
        self._recent.append(Moment(*small_grey(frame_bgr), box if surely else None, box))
        self._seen_frames += 1
        if surely and self._seen_frames % REMEMBER_EVERY == 0:
            self._redetector.remember(frame_bgr, box)

    def doubted(self, frame_bgr: Image) -> None:
        """Whether the target was seen in this frame is not known yet."""
        self._recent.append(Moment(*small_grey(frame_bgr), None, self._recent[-1].box))

    def resembles(self, frame_bgr: Image, box: Box, score: float) -> bool:
        """Whether what is in this box looks rather like the target, now or of late, than like anything else."""
        return self._redetector.resembles(frame_bgr, box, score)

    def lose(self, frame_bgr: Image) -> None:
        """The target is not in this frame, where it was looked for; nor was it in those that were doubted."""
        self._path = StabilisedPath()
        frames = list(self._recent)
        for before, now in zip([None, *frames], frames, strict=False):
            if before is not None:
                self._path.move(background_motion(before.grey, now.grey, now.scale, before.box))
            if now.seen is not None:
                self._path.observe(now.seen.cx_px, now.seen.cy_px)
        self._size = frames[-1].box
        if self._path.expected() is None:
            self._path.observe(self._size.cx_px, self._size.cy_px)
        self._redetector.start(frame_bgr, self.expected)

    def search(self, frame_bgr: Image) -> Candidate | None:
        """Look into this frame; a candidate only when it has proved itself."""
        grey, scale = small_grey(frame_bgr)
        before = self._recent[-1]
        motion = background_motion(before.grey, grey, scale, before.box)
        self._path.move(motion)
        self._keep_in_frame(frame_bgr.shape[1], frame_bgr.shape[0])
        found = self._redetector.search(frame_bgr, motion, self._path.velocity, self._path.expected())
        self._recent.append(Moment(grey, scale, None, self.expected))
        return found.believed

    def _keep_in_frame(self, width_px: int, height_px: int) -> None:
        """What has left the frame waits at its edge: further out no motion of the background is known."""
        place = self._path.expected()
        if place is None or (0 <= place[0] <= width_px and 0 <= place[1] <= height_px):
            return
        self._path = StabilisedPath()
        self._path.observe(min(max(place[0], 0.0), width_px), min(max(place[1], 0.0), height_px))

    @property
    def expected(self) -> Box:
        """Where the target should be in the frame that was searched last, at the size it had."""
        place = self._path.expected()
        return self._size if place is None else replace(self._size, cx_px=place[0], cy_px=place[1])

    def expect(self, cx_px: float, cy_px: float) -> None:
        """Someone who knows better says where it should be in the last frame."""
        self._redetector.expect(cx_px, cy_px)

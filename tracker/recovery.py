"""Losing the target and finding it again: where it should be, and where to look for it."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from tracker.box import Box
from tracker.candidates import Candidate
from tracker.configs import TrackerConfig
from tracker.crop import Image
from tracker.decode import Calibration
from tracker.motion import PATH_FRAMES, Grey, Homography, StabilisedPath, background_motion, small_grey
from tracker.network.climrt import ClimRT, Features
from tracker.redetect import Redetector

DOUBTFUL_FRAMES = 3  # in a row, after which the target is looked for elsewhere
RESEMBLING = 0.2  # log-odds; others of its kind reach a little over 0
REMEMBER_EVERY = 10  # frames between two looks at what else is like the target


class Recovery:
    """Keeps of a track what is needed once the target is lost, and then looks for it.

    `seen` in each frame with the target; `lose` in the first without; then `search` in that frame and the
    following ones, until it returns something believed.
    The camera's motion is worked out only when the target is lost: then for the last frames at once.
    """

    def __init__(
        self,
        network: ClimRT,
        config: TrackerConfig,
        frame_bgr: Image,
        box: Box,
        template: Features,
        calibration: Calibration | None,
    ) -> None:
        self._redetector = Redetector(network, config, frame_bgr, box, template, calibration=calibration)
        # Grey picture, its scale, the target's box where it was seen, and where it is as far as is known.
        self._recent: deque[tuple[Grey, float, Box | None, Box]] = deque(maxlen=PATH_FRAMES + DOUBTFUL_FRAMES)
        self._path = StabilisedPath()
        self._size = box
        self._seen_frames = 0
        self.seen(frame_bgr, box, surely=True)

    def seen(self, frame_bgr: Image, box: Box, *, surely: bool = False) -> None:
        """The target is in this box; surely: so that its way, and what is beside it, can be learned from it."""
        self._recent.append((*small_grey(frame_bgr), box if surely else None, box))
        self._seen_frames += 1
        if surely and self._seen_frames % REMEMBER_EVERY == 0:
            self._redetector.remember(frame_bgr, box)

    def doubted(self, frame_bgr: Image) -> None:
        """Whether the target was seen in this frame is not known yet."""
        self._recent.append((*small_grey(frame_bgr), None, self._recent[-1][3]))

    def resembles(self, frame_bgr: Image, box: Box, score: float) -> bool:
        """Whether what is in this box looks rather like the target, now or of late, than like anything else."""
        judged = self._redetector.judge(frame_bgr, box, score)
        return judged.log_odds > RESEMBLING and judged.likeness > judged.distractor_likeness

    def lose(self, frame_bgr: Image) -> None:
        """The target is not in this frame, where it was looked for; nor was it in those that were doubted."""
        self._path = StabilisedPath()
        frames = list(self._recent)
        for i, (grey, scale, box, _) in enumerate(frames):
            if i:
                self._path.move(_motion(frames[i - 1], grey, scale))
            if box is not None:
                self._path.observe(box.cx_px, box.cy_px)
        self._size = frames[-1][3]
        if self._path.expected() is None:
            self._path.observe(self._size.cx_px, self._size.cy_px)
        self._redetector.start(frame_bgr, self.expected)

    def search(self, frame_bgr: Image) -> Candidate | None:
        """Look into this frame; a candidate only when it has proved itself."""
        grey, scale = small_grey(frame_bgr)
        motion = _motion(self._recent[-1], grey, scale)
        self._path.move(motion)
        self._keep_in_frame(frame_bgr.shape[1], frame_bgr.shape[0])
        found = self._redetector.search(frame_bgr, motion, self._path.velocity, self._path.expected())
        self._recent.append((grey, scale, None, self.expected))
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


def _motion(before: tuple[Grey, float, Box | None, Box], grey: Grey, scale: float) -> Homography | None:
    """Of the background since then."""
    return background_motion(before[0], grey, scale, before[3]) if before[0].shape == grey.shape else None

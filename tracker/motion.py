"""Motion in the image: of the background, which tells the camera's own, and of the target over it."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.box import Box
from tracker.crop import Image

Homography = NDArray[np.float64]  # (3, 3), maps px of the previous frame to px of the current one
Grey = NDArray[np.uint8]  # (H, W)
Points = NDArray[np.float32]  # (N, 1, 2) x, y

MAX_WIDTH_PX = 480
CORNERS = 150
CORNER_QUALITY = 0.01
CORNER_SPACING_FRAC = 1 / 32  # of the small picture's width
WINDOW_PX = 15
LEVELS = 3
PATH_FRAMES = 5
PATH_MEMORY_FRAMES = 20  # time constant with which a target's way out of sight is taken to come to rest
AGREE_SMALL_PX = 1.0  # in the small picture
MIN_INLIERS = 12
MIN_INLIER_FRAC = 0.4
MAX_LOG_SCALE = 0.2  # between two frames
MAX_TURN_RAD = 0.35
EXCLUDE_GROWTH = 1.3  # the box is never exact, and the target's shadow moves with it


def small_grey(frame_bgr: Image) -> tuple[Grey, float]:
    """The frame in grey, halved until at most 480 px wide, and small px per frame px.

    Exact halves, averaged: the fastest shrinking there is that does not alias.
    """
    small = frame_bgr
    while small.shape[1] > MAX_WIDTH_PX:
        size = (small.shape[1] // 2, small.shape[0] // 2)
        small = np.asarray(cv2.resize(small, size, interpolation=cv2.INTER_AREA), np.uint8)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), np.uint8), small.shape[1] / frame_bgr.shape[1]


def carry(box: Box, motion: Homography) -> Box:
    """The box moved and scaled by the motion at its centre; an axis-aligned box does not turn."""
    x, y, w = motion @ (box.cx_px, box.cy_px, 1.0)
    x, y = float(x / w), float(y / w)
    # Area factor of the projective map at the centre: det(H) / w^3.
    growth = math.sqrt(max(float(np.linalg.det(motion)) / float(w) ** 3, 1e-6))
    return Box(x, y, box.w_px * growth, box.h_px * growth)


class StabilisedPath:
    """The target's own way over the ground: its last places, carried along with the camera's motion.

    Where it is expected is where it was last seen, as the background has moved since, and on by its mean
    velocity over the last frames in which it was seen. Per frame: first `move`, then `observe` if it was seen.
    """

    def __init__(self, frames: int = PATH_FRAMES) -> None:
        """frames: length of the past that the velocity is taken from."""
        self._frames = frames
        self._places: deque[tuple[int, float, float]] = deque(maxlen=frames + 1)  # frame number, x, y now
        self._now = 0

    def move(self, motion: Homography | None) -> None:
        """To the next frame, over which the background moved so; unknown motion counts as none."""
        self._now += 1
        if motion is None:
            return
        for i, (number, x, y) in enumerate(self._places):
            u, v, w = motion @ (x, y, 1.0)
            self._places[i] = (number, float(u / w), float(v / w))

    def observe(self, cx_px: float, cy_px: float) -> None:
        """The target is seen here in the current frame."""
        while self._places and self._now - self._places[0][0] > self._frames:
            self._places.popleft()
        self._places.append((self._now, cx_px, cy_px))

    @property
    def unseen_frames(self) -> int:
        """Frames since the last observation; 0 if there was none yet."""
        return self._now - self._places[-1][0] if self._places else 0

    @property
    def velocity(self) -> tuple[float, float]:
        """Of the target over the ground, px of the current frame per frame; less and less while it is unseen.

        Nobody walks on for ever: it is taken to decay, as in Singer's model of manoeuvring targets.
        """
        if len(self._places) < 2:
            return 0.0, 0.0
        (first, x0, y0), (last, x1, y1) = self._places[0], self._places[-1]
        rate = math.exp(-self.unseen_frames / PATH_MEMORY_FRAMES) / (last - first)
        return (x1 - x0) * rate, (y1 - y0) * rate

    def expected(self) -> tuple[float, float] | None:
        """Centre (px) where the target should be in the current frame; None if it was never seen."""
        if not self._places:
            return None
        _, x, y = self._places[-1]
        vx, vy = self.velocity
        frames = PATH_MEMORY_FRAMES * math.expm1(self.unseen_frames / PATH_MEMORY_FRAMES)  # of today's velocity
        return x + vx * frames, y + vy * frames


def background_motion(previous: Grey, grey: Grey, scale: float, exclude: Box | None = None) -> Homography | None:
    """How the background moved between two frames (3, 3), frame px; None where it is not known.

    previous, grey: pictures of `small_grey`; of different sizes, they tell nothing. scale: small px per frame px.
    exclude: the target's box in the previous frame, whose motion is its own, frame px.
    Corners outside the target, followed by Lucas and Kanade's pyramid; a robust fit (MAGSAC) finds the
    homography that most of them share: the ground is nearly a plane, and a slanted one makes no similarity.
    Frames without enough agreement give None: then nothing is known, which is not "no motion".
    """
    if previous.shape != grey.shape:
        return None
    small = _background_motion(previous, grey, _scaled(exclude, scale) if exclude is not None else None)
    return _enlarged(small, 1 / scale) if small is not None else None


def _background_motion(previous: Grey, grey: Grey, exclude: Box | None) -> Homography | None:
    height, width = previous.shape
    mask = None
    if exclude is not None:
        mask = np.full((height, width), 255, np.uint8)
        x, y, w, h = replace(exclude, w_px=exclude.w_px * EXCLUDE_GROWTH, h_px=exclude.h_px * EXCLUDE_GROWTH).xywh
        mask[max(0, int(y)) : max(0, math.ceil(y + h)), max(0, int(x)) : max(0, math.ceil(x + w))] = 0
    found = cv2.goodFeaturesToTrack(previous, CORNERS, CORNER_QUALITY, width * CORNER_SPACING_FRAC, mask=mask)
    if found is None or len(found) < MIN_INLIERS:
        return None
    corners = np.asarray(found, np.float32)
    moved, followed = _follow(previous, grey, corners, WINDOW_PX)
    if followed.sum() < MIN_INLIERS:
        return None
    motion, inliers = cv2.findHomography(corners[followed], moved[followed], cv2.USAC_MAGSAC, AGREE_SMALL_PX)
    if motion is None or inliers.sum() < max(MIN_INLIERS, MIN_INLIER_FRAC * followed.sum()):
        return None
    background: Homography = np.asarray(motion, np.float64)
    return background if _is_plausible(background, width, height) else None


def _follow(previous: Grey, grey: Grey, points: Points, window_px: int) -> tuple[Points, NDArray[np.bool_]]:
    """Where the points went (N, 1, 2), and which of them could be followed (N,)."""
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        previous, grey, points, points.copy(), winSize=(window_px, window_px), maxLevel=LEVELS
    )
    return np.asarray(moved, np.float32), np.asarray(status).ravel() == 1


def _is_plausible(motion: Homography, width: int, height: int) -> bool:
    """No aircraft zooms or turns more than this within a frame, in any corner of the picture."""
    for x in (0, width):
        for y in (0, height):
            xx, yy, w = (float(v) for v in motion @ (x, y, 1.0))
            if w <= 0:
                return False
            # What becomes of a small step to the right: the x column of the Jacobian.
            step_x, step_y = (motion[0, 0] - xx / w * motion[2, 0]) / w, (motion[1, 0] - yy / w * motion[2, 0]) / w
            size = math.hypot(step_x, step_y)
            if not math.exp(-MAX_LOG_SCALE) <= size <= math.exp(MAX_LOG_SCALE):
                return False
            if abs(math.atan2(step_y, step_x)) > MAX_TURN_RAD:
                return False
    return True


def _scaled(box: Box, factor: float) -> Box:
    return Box(box.cx_px * factor, box.cy_px * factor, box.w_px * factor, box.h_px * factor)


def _enlarged(motion: Homography, factor: float) -> Homography:
    """The same motion in a picture `factor` times as large; pixel centres are half a pixel in."""
    shift = (factor - 1) / 2
    grow = np.array([[factor, 0, shift], [0, factor, shift], [0, 0, 1]])
    return np.asarray(grow @ motion @ np.linalg.inv(grow))

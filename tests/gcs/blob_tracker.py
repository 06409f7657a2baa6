"""A tracker for tests that needs no weights: the patch of the first box's colour, nearest to the last box."""

from __future__ import annotations

import cv2
import numpy as np

from gcs.video.frame import Image
from tracker.box import Box, TrackResult

_REACH = 1.5  # search window, in box sides


class BlobTracker:
    """Follows anything red on a ground that is not."""

    def __init__(self) -> None:
        self.box: Box | None = None
        self.inits: list[Box] = []

    def init(self, frame_bgr: Image, box: Box) -> None:
        if not box.is_valid:
            raise ValueError("the box is empty")
        self.box = box
        self.inits.append(box)

    def update(self, frame_bgr: Image) -> TrackResult:
        assert self.box is not None
        found = self._find(frame_bgr, self.box)
        if found is None:
            return TrackResult(self.box, 0.0, 0.0)
        # As Siamese trackers do: less of the object scores lower, and a low score changes the size slowly.
        last = self.box
        confidence = min(0.95, found.w_px * found.h_px / (last.w_px * last.h_px))
        rate = 0.3 * confidence
        self.box = Box(
            found.cx_px,
            found.cy_px,
            last.w_px + rate * (found.w_px - last.w_px),
            last.h_px + rate * (found.h_px - last.h_px),
        )
        return TrackResult(self.box, confidence, confidence)

    def _find(self, frame_bgr: Image, last: Box) -> Box | None:
        blue, green, red = (frame_bgr[:, :, i].astype(np.int16) for i in range(3))
        mask = ((red - np.maximum(blue, green)) > 45).astype(np.uint8)
        x, y, w, h = last.xywh
        window = np.zeros_like(mask)
        left, right = int(max(x - _REACH * w, 0)), int(max(x + w + _REACH * w, 0))
        top, bottom = int(max(y - _REACH * h, 0)), int(max(y + h + _REACH * h, 0))
        window[top:bottom, left:right] = mask[top:bottom, left:right]
        window = cv2.morphologyEx(window, cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
        count, _, stats, centres = cv2.connectedComponentsWithStats(window)
        best, best_px = None, np.inf
        for i in range(1, count):
            if stats[i, cv2.CC_STAT_AREA] < 0.15 * w * h:
                continue
            distance = float(np.hypot(centres[i][0] - last.cx_px, centres[i][1] - last.cy_px))
            if distance < best_px:
                best, best_px = i, distance
        if best is None:
            return None
        x, y, w, h, _ = (float(v) for v in stats[best])
        return Box.from_xywh(x, y, w, h)

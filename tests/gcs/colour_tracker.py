"""A tracker for the generated clips: finds the red square, and says so when it cannot."""

from __future__ import annotations

import numpy as np

from tests.gcs.clips import Picture
from tracker.box import Box, TrackResult


class ColourTracker:
    """Follows red; `init` takes any box."""

    def __init__(self) -> None:
        self._box = Box(0.0, 0.0, 0.0, 0.0)

    def init(self, frame_bgr: Picture, box: Box) -> None:
        self._box = box

    def update(self, frame_bgr: Picture) -> TrackResult:
        red = frame_bgr[:, :, 2].astype(int) - frame_bgr[:, :, 1] > 80
        rows, columns = np.nonzero(red)
        if len(rows) < 20:
            return TrackResult(self._box, 0.1, 0.05)
        left, top = int(columns.min()), int(rows.min())
        self._box = Box.from_xywh(left, top, int(columns.max()) - left + 1, int(rows.max()) - top + 1)
        return TrackResult(self._box, 5.0, 0.95)

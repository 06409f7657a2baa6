"""Whether the target is turning: innovations that keep to one side are no noise.

A filter quick enough for a target that turns on the spot is far too nervous for one that walks straight on. So the
process noise of the azimuth goes between two values, by how far the mean of the newest innovations stands out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

_MEMORY_S = 0.25  # of the mean: some five pictures
_SPREAD_MEMORY_S = 2.0
_QUIET, _CERTAIN = 1.6, 2.6  # standard deviations of the mean: nothing, and all, of a manoeuvre
_LARGEST = 4.0  # innovations count up to so many standard deviations: one outlier is no manoeuvre
_LEAST_VARIANCE = 0.5


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """What the innovations were like, in the standard deviations the calm filter expects. level: 0 calm, 1 turning."""

    mean: float = 0.0
    variance: float = 1.0  # larger where boxes are noisier than the filter is told
    level: float = 0.0

    def after(self, innovation: float, dt_s: float) -> Manoeuvre:
        """With one more innovation, dt_s after the one before."""
        spread = math.sqrt(self.variance)
        innovation = min(max(innovation, -_LARGEST * spread), _LARGEST * spread)
        kept = math.exp(-dt_s / _MEMORY_S)
        mean = kept * self.mean + (1 - kept) * innovation
        mean_std = spread * math.sqrt((1 - kept) / (1 + kept))  # of white innovations, averaged like this
        level = (abs(mean) / mean_std - _QUIET) / (_CERTAIN - _QUIET)
        square = min(innovation * innovation, 6.0 * self.variance)
        variance = self.variance + (square - self.variance) * min(dt_s / _SPREAD_MEMORY_S, 1.0)
        return Manoeuvre(mean, max(variance, _LEAST_VARIANCE), min(max(level, 0.0), 1.0))

"""First boxes that are a little off, as an operator draws them.

The spatial robustness evaluation (SRE) of Wu, Lim and Yang, "Object Tracking Benchmark", PAMI 2015: eight shifts by a
tenth of the target's size, to the sides and the corners, and four scales.
"""

from __future__ import annotations

from typing import NamedTuple

from tracker.box import Box

SHIFT_FRAC = 0.1
SCALES = (0.8, 0.9, 1.1, 1.2)


class Start(NamedTuple):
    """How the first box differs from the true one: shifted by shares of its sides, scaled about its centre."""

    name: str
    right_frac: float = 0.0
    down_frac: float = 0.0
    scale: float = 1.0

    def of(self, box: Box) -> Box:
        """The box that is given instead."""
        return Box(
            box.cx_px + self.right_frac * box.w_px,
            box.cy_px + self.down_frac * box.h_px,
            box.w_px * self.scale,
            box.h_px * self.scale,
        )


EXACT = Start("exact")
SRE = (
    *(
        Start(f"{down}-{right}".strip("-"), right_sign * SHIFT_FRAC, down_sign * SHIFT_FRAC)
        for down, down_sign in (("up", -1), ("", 0), ("down", 1))
        for right, right_sign in (("left", -1), ("", 0), ("right", 1))
        if down or right
    ),
    *(Start(f"scale-{scale:g}", scale=scale) for scale in SCALES),
)

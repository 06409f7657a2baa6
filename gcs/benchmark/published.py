"""What others say of theirs: not measured here, so never in a ratio."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Published:
    """Somebody else's figure, on somebody else's machine."""

    name: str
    figure: str
    where: str


FIGURES: Final = (
    Published("NanoTrack v3", "107 pictures a second", "one CPU thread, Cascade Lake at 2.5 GHz (sgemm 114 GFLOP/s)"),
    Published("ClimRT, the paper", "19.7 pictures a second", "full with ClimNet, on a TITAN RTX"),
    Published("PixEagle, HUD", "26 to 31 ms a picture", "720p"),
    Published("PixEagle, idle", "0.7 to 1.5 cores", "720p"),
)

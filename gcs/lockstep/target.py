"""What is followed in a lockstep flight."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from sitl_mocks.monitor import Vec3

STEP_S = 0.01


class Target(Protocol):
    """Something that is somewhere (NED, metres) and moves on in steps of STEP_S."""

    @property
    def position_ned_m(self) -> Vec3:
        """Its middle."""
        ...

    def step(self, now_s: float) -> None:
        """Be where it is at now_s."""
        ...


@dataclass(slots=True)
class Walker:
    """Walks on level ground with a weave; anybody may change how, at any time."""

    position_ned_m: Vec3
    speed_mps: float = 0.0
    heading_rad: float = 0.0
    weave_rad: float = 0.35

    def step(self, now_s: float) -> None:
        """Advance by STEP_S."""
        heading = self.heading_rad + self.weave_rad * math.sin(0.9 * now_s)
        north, east, down = self.position_ned_m
        length_m = self.speed_mps * STEP_S
        self.position_ned_m = (north + length_m * math.cos(heading), east + length_m * math.sin(heading), down)

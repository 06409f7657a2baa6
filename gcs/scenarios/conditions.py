"""Under what a scenario is flown."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from control.config import ControlConfig
from control.fence import Fence
from control.gate import Limits
from control.modes import FollowMode
from gcs.lockstep.world import DELAY_S
from sitl_mocks.dynamics import Airframe
from sitl_mocks.monitor import Vec3
from sitl_mocks.vehicle import Personality

FENCE_M = 500.0


class TrackerKind(Enum):
    """Whose boxes: of a model that works on boxes, or of the real tracker on painted pictures."""

    MODEL = "model"
    REAL = "real"


class LawKind(Enum):
    """Who steers: the station, or for comparison a P controller on the raw box."""

    STATION = "station"
    NAIVE = "naive"


def default_config() -> ControlConfig:
    """The defaults, with room to fly."""
    return ControlConfig(limits=Limits(fence=Fence(radius_m=FENCE_M, max_height_m=60.0)))


@dataclass(frozen=True, slots=True)
class Conditions:
    """One way to fly a scenario.

    delay_s: from light to box, tracker included. delay_error_s: how much more of it the station believes in.
    delay_given: False leaves it to find the camera's delay out by itself. mode: None is the scenario's own.
    link_delay_s: each way. airframe: None is the autopilot's as measured. attitude_rate_hz: the most that the vehicle
    sends; None: as asked. gimbal: the camera is on one, not fixed.
    """

    seed: int = 1
    mode: FollowMode | None = None
    delay_s: float = 0.1
    delay_error_s: float = 0.0
    delay_given: bool = True
    fps: float = 20.0
    tracker: TrackerKind = TrackerKind.MODEL
    law: LawKind = LawKind.STATION
    noise_px: float = 2.0
    personality: Personality = Personality.PX4
    wind_ned_mps: Vec3 = (0.0, 0.0, 0.0)
    gust_mps: float = 0.0  # standard deviation
    loss_frac: float = 0.0  # each way
    link_delay_s: float = DELAY_S
    attitude_rate_hz: float | None = None
    airframe: Airframe | None = None
    gimbal: bool = False
    config: ControlConfig = field(default_factory=default_config)

"""A scripted flight behind the target: it knows the truth, so it needs no tracker. For recordings and tests."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from sitl_mocks.dynamics import Motion, MotionCommand, Multicopter, wrap_pi
from sitl_mocks.scenario import Scenario

_STEP_S = 0.02
_SPEED_MAX_MPS = 8.0


@dataclass(frozen=True, slots=True)
class Moment:
    """The vehicle's true state at scenario time t_s: NED metres and m/s, rad."""

    t_s: float
    position_ned_m: tuple[float, float, float]
    velocity_ned_mps: tuple[float, float, float]
    roll_rad: float
    pitch_rad: float
    yaw_rad: float


def follow(scenario: Scenario, fps: float, until_s: float) -> Iterator[Moment]:
    """The vehicle from scenario time 0, hovering at home, once per frame; it keeps the first distance."""
    start = Motion(position_ned_m=(0.0, 0.0, -scenario.height_m), yaw_rad=scenario.heading_rad, on_ground=False)
    body = Multicopter(motion=start)
    distance_m = math.hypot(*scenario.world.target(0.0).position_ned_m[:2])
    steps_per_frame = max(round(1 / fps / _STEP_S), 1)
    for step in range(int(until_s / _STEP_S)):
        t_s = step * _STEP_S
        if step % steps_per_frame == 0:
            m = body.motion
            yield Moment(t_s, m.position_ned_m, m.velocity_ned_mps, m.roll_rad, m.pitch_rad, m.yaw_rad)
        body.step(_STEP_S, _command(body.motion, scenario, t_s, distance_m))


def _command(motion: Motion, scenario: Scenario, t_s: float, distance_m: float) -> MotionCommand:
    """Keep the distance along the line to the target, and turn towards it, both with its true motion fed forward."""
    target = scenario.world.target(t_s)
    north = target.position_ned_m[0] - motion.position_ned_m[0]
    east = target.position_ned_m[1] - motion.position_ned_m[1]
    apart = max(math.hypot(north, east), 1.0)
    ahead = (north / apart, east / apart)
    closing = ahead[0] * target.velocity_ned_mps[0] + ahead[1] * target.velocity_ned_mps[1]
    speed = max(-_SPEED_MAX_MPS, min(_SPEED_MAX_MPS, 0.6 * (apart - distance_m) + closing))
    turning = (ahead[0] * target.velocity_ned_mps[1] - ahead[1] * target.velocity_ned_mps[0]) / apart
    error = wrap_pi(math.atan2(east, north) - motion.yaw_rad)
    climb = 0.8 * (-scenario.height_m - motion.position_ned_m[2])
    return MotionCommand((speed * ahead[0], speed * ahead[1], climb), 1.5 * error + turning)

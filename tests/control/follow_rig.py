"""A vehicle 5 m up, a target on the ground 15 m ahead of it, and what a law makes of the two."""

import math
from dataclasses import replace

from control.camera import CameraModel
from control.config import FollowConfig
from control.laws import Scene, velocity_wish
from control.limits import Wish
from control.modes import Confirmation, FollowMode, confirm, sure_ground_m
from control.motion import TargetMotion, target_motion
from control.types import TargetState, VehicleState

CONFIG = FollowConfig()
CAMERA = CameraModel.from_hfov(640, 480, math.radians(80), mount_rpy_rad=(0.0, math.radians(-15), 0.0))
VEHICLE = VehicleState(attitude_t_s=10.0, position_t_s=10.0, position_ned_m=(3.0, 4.0, -5.0), height_m=5.0)
STILL = (0.0, 0.0, 0.0)
DOWN = -math.atan2(5.0, 15.0)


def target(**changes) -> TargetState:
    base = TargetState(
        t_s=10.0, azimuth_rad=0.0, azimuth_rate_rps=0.0, elevation_rad=DOWN, elevation_rate_rps=0.0, log_size=-2.5,
        log_size_rate_ps=0.0, azimuth_std_rad=0.01, azimuth_rate_std_rps=0.0, log_size_std=0.01, confidence=1.0,
        measured_t_s=10.0, rejections_in_a_row=0,
    )  # fmt: skip
    return replace(base, **changes)


def confirmed(mode=FollowMode.FOLLOW, config=CONFIG, **kwargs) -> Confirmation:
    return confirm(mode, target(), VEHICLE, 10.0, config, **kwargs)


def wish(
    vehicle=VEHICLE, own=STILL, coasting=False, config=CONFIG, mode=FollowMode.FOLLOW, confirmation=None, **changes
) -> Wish:
    """What the law would like at once: nothing filtered, nothing shaped."""
    confirmation = confirmation or confirmed(mode, config)
    seen = target(**changes)
    ground_m = None if confirmation.ground_factor is None else sure_ground_m(seen, vehicle, config)
    motion = target_motion(confirmation, seen, own, config, ground_m)
    return velocity_wish(Scene(confirmation, seen, vehicle, CAMERA, config, motion, own, coasting))


def ground_motion(ground_m=15.0, own=STILL, **changes) -> TargetMotion:
    return target_motion(confirmed(), target(**changes), own, CONFIG, ground_m)

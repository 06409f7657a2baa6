"""How hard the vehicle may accelerate before a camera fixed to it loses the target: it leans to accelerate."""

from __future__ import annotations

import math

from control.camera import CameraModel
from control.config import FollowConfig

_GRAVITY_MPS2 = 9.81
_MAX_TILT_RAD = math.radians(80)


def view_acceleration_mps2(elevation_rad: float, camera: CameraModel, config: FollowConfig) -> tuple[float, float]:
    """Bounds (low, high) of the acceleration towards the target whose pitch keeps it in a fixed camera's view.

    Accelerating forward by a pitches the nose down by atan(a / g), which moves the target up in the picture.
    """
    half_rad = camera.vfov_rad * (0.5 - config.view_margin_frac)
    off_axis_rad = elevation_rad - camera.mount_rpy_rad[1]
    up_rad = min(max(half_rad - off_axis_rad, -_MAX_TILT_RAD), _MAX_TILT_RAD)
    down_rad = min(max(half_rad + off_axis_rad, -_MAX_TILT_RAD), _MAX_TILT_RAD)
    least = config.min_acceleration_mps2
    high = max(_GRAVITY_MPS2 * math.tan(up_rad), least)
    return min(-_GRAVITY_MPS2 * math.tan(down_rad), -least), high

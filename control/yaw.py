"""The yaw law: turn the camera's axis onto the predicted target."""

from __future__ import annotations

from control.attitude import wrap_pi
from control.camera import CameraModel
from control.config import FollowConfig
from control.motion import fade
from control.types import TargetState, VehicleState

_MAX_YAW_LEAD_S = 0.3


def yaw_rate_rps(target: TargetState, vehicle: VehicleState, camera: CameraModel, config: FollowConfig) -> float:
    """Turn the camera's axis onto the predicted azimuth: P with the bearing rate fed forward, bounded.

    The bearing rate fades as the filter knows less of it. yaw_lag_s answers the lag of the vehicle's own
    rate loop: the wanted rate, carried on by the rate at which it is changing.
    """
    lead_s = 0.0
    if vehicle.attitude_t_s is not None:
        lead_s = min(max(target.t_s - vehicle.attitude_t_s, 0.0), _MAX_YAW_LEAD_S)
    heading_rad = vehicle.yaw_rad + vehicle.yaw_rate_rps * lead_s + camera.mount_rpy_rad[2]
    forward_rps = target.azimuth_rate_rps * fade(target.azimuth_rate_std_rps, config.feed_forward_std_rps)
    rate = config.yaw_gain_ps * wrap_pi(target.azimuth_rad - heading_rad) + forward_rps
    rate += config.yaw_lag_s * config.yaw_gain_ps * (forward_rps - vehicle.yaw_rate_rps)
    return min(max(rate, -config.max_yaw_rate_rps), config.max_yaw_rate_rps)

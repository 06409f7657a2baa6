"""The yaw law."""

import math
from dataclasses import replace

import pytest

from control.yaw import yaw_rate_rps

from .follow_rig import CAMERA, CONFIG, VEHICLE, target


@pytest.mark.parametrize(("azimuth", "yaw", "sign"), [(0.3, 0.0, 1), (-0.3, 0.0, -1), (-3.0, 3.0, 1), (3.0, -3.0, -1)])
def test_yaw_turns_the_short_way_towards_the_target(azimuth, yaw, sign):
    rate = yaw_rate_rps(target(azimuth_rad=azimuth), replace(VEHICLE, yaw_rad=yaw), CAMERA, CONFIG)
    assert math.copysign(1, rate) == sign
    assert abs(rate) <= CONFIG.max_yaw_rate_rps


def test_yaw_feeds_the_bearing_rate_forward_as_far_as_it_is_known():
    def rate(std):
        return yaw_rate_rps(target(azimuth_rate_rps=0.2, azimuth_rate_std_rps=std), turning, CAMERA, CONFIG)

    turning = replace(VEHICLE, yaw_rate_rps=0.2)
    assert rate(0.0) == pytest.approx(0.2)
    assert rate(100.0) < 0.01


def test_yaw_takes_the_turn_since_the_telemetry_and_the_mount_into_account():
    turning = replace(VEHICLE, yaw_rate_rps=0.5)
    config = replace(CONFIG, yaw_lag_s=0.0)
    assert yaw_rate_rps(target(t_s=10.2, azimuth_rad=0.1), turning, CAMERA, config) == pytest.approx(0.0)
    assert yaw_rate_rps(target(azimuth_rad=0.1), replace(turning, attitude_t_s=None), CAMERA, config) > 0
    aside = replace(CAMERA, mount_rpy_rad=(0.0, 0.0, 0.4))
    assert yaw_rate_rps(target(azimuth_rad=0.4), VEHICLE, aside, config) == pytest.approx(0.0)

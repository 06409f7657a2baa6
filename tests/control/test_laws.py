"""The modes one by one: signs, and what each holds."""

import math
from dataclasses import replace

import pytest

from control.modes import FollowMode

from .follow_rig import CONFIG, VEHICLE, confirmed, wish


def test_spotlight_comes_back_to_its_place_and_height():
    blown = replace(VEHICLE, position_ned_m=(4.0, 3.0, -6.0), height_m=6.0)
    north, east, down = wish(blown, mode=FollowMode.SPOTLIGHT).velocity_ned_mps
    assert north < 0 < east
    assert down > 0
    far = replace(VEHICLE, position_ned_m=(103.0, 4.0, -5.0))
    speed = math.hypot(*wish(far, mode=FollowMode.SPOTLIGHT).velocity_ned_mps[:2])
    assert speed == pytest.approx(CONFIG.max_station_speed_mps)


def test_spotlight_does_not_care_for_the_distance():
    assert wish(mode=FollowMode.SPOTLIGHT, log_size=-3.0).velocity_ned_mps == (0.0, 0.0, 0.0)


def test_follow_closes_in_on_a_far_target_and_backs_off_from_a_near_one():
    assert wish().velocity_ned_mps == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert wish(log_size=-2.7).velocity_ned_mps[0] > 0.5
    assert wish(log_size=-2.3).velocity_ned_mps[0] < -0.5
    east = wish(azimuth_rad=math.pi / 2, log_size=-2.7).velocity_ned_mps
    assert east[1] > 0.5
    assert east[0] == pytest.approx(0, abs=1e-9)


def test_follow_moves_along_with_the_target():
    """Target over ground: 2 m/s across to the right (bearing rate 2/15), and 1.5 m/s away."""
    seen = wish(azimuth_rate_rps=2 / 15, log_size_rate_ps=-0.1)
    gain = CONFIG.target_velocity_gain
    assert seen.velocity_ned_mps == pytest.approx((1.5 * gain, 2.0 * gain, 0.0))
    # Flying alongside already, the line of sight stands still, and the answer is the same.
    alongside = wish(own=(1.5, 2.0, 0.0))
    assert alongside.velocity_ned_mps == pytest.approx((1.5 * gain, 2.0 * gain, 0.0))


def test_a_shrinking_box_at_the_same_depression_is_hardly_chased():
    half = -2.5 + math.log(0.5)
    flat = replace(confirmed(), ground_factor=None)
    chased = wish(confirmation=flat, log_size=half, log_size_rate_ps=-0.5)
    assert chased.velocity_ned_mps[0] == pytest.approx(CONFIG.max_speed_mps)
    assert wish(log_size=half, size_trust=0.0).velocity_ned_mps[0] < 0.5


def test_speed_and_height_are_bounded():
    fast = wish(azimuth_rate_rps=1.0, log_size=-2.9)
    assert math.hypot(*fast.velocity_ned_mps[:2]) == pytest.approx(CONFIG.max_speed_mps)
    assert "speed" in fast.limited_by
    low = wish(vehicle=replace(VEHICLE, height_m=1.0))
    assert low.velocity_ned_mps[2] == -CONFIG.max_vertical_mps
    high = wish(vehicle=replace(VEHICLE, height_m=5.5))
    assert high.velocity_ned_mps[2] == pytest.approx(0.5 * CONFIG.height_gain_ps)

"""The modes one by one: signs, and what each holds."""

import math
from dataclasses import replace

import pytest

from control.laws import circle_speed_mps
from control.modes import FollowMode

from .follow_rig import CONFIG, DOWN, VEHICLE, confirmed, wish


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
    expected = (1.5 * CONFIG.target_velocity_gain, 2.0 * CONFIG.sideways_gain, 0.0)
    assert seen.velocity_ned_mps == pytest.approx(expected)
    # Flying alongside already, the line of sight stands still, and the answer is the same.
    alongside = wish(own=(1.5, 2.0, 0.0))
    assert alongside.velocity_ned_mps == pytest.approx(expected)


def test_a_shrinking_box_at_the_same_depression_is_hardly_chased():
    half = -2.5 + math.log(0.5)
    flat = replace(confirmed(), ground_factor=None)
    chased = wish(confirmation=flat, log_size=half, log_size_rate_ps=-0.5)
    assert chased.velocity_ned_mps[0] == pytest.approx(CONFIG.max_speed_mps)
    assert wish(log_size=half, size_trust=0.0).velocity_ned_mps[0] < 0.5


def test_speed_and_height_are_bounded():
    far = replace(confirmed(FollowMode.PARALLEL), range_m=30.0, confirmed_range_m=30.0, ground_factor=None)
    fast = wish(azimuth_rate_rps=1.0, confirmation=far)
    assert math.hypot(*fast.velocity_ned_mps[:2]) == pytest.approx(CONFIG.max_speed_mps)
    assert "speed" in fast.limited_by
    low = wish(vehicle=replace(VEHICLE, height_m=1.0))
    assert low.velocity_ned_mps[2] == -CONFIG.max_vertical_mps
    high = wish(vehicle=replace(VEHICLE, height_m=5.5))
    assert high.velocity_ned_mps[2] == pytest.approx(0.5 * CONFIG.height_gain_ps)


def test_distance_comes_before_what_is_across():
    """Both cannot be had at max_speed_mps: the way back from a near target is not shortened by sliding past it."""
    far = replace(
        confirmed(FollowMode.PARALLEL), standoff_m=34.0, range_m=30.0, confirmed_range_m=30.0, ground_factor=None
    )
    near = wish(azimuth_rate_rps=1.0, confirmation=far).velocity_ned_mps
    alone = wish(confirmation=far).velocity_ned_mps
    assert near[0] == pytest.approx(alone[0])
    assert alone[0] < -0.5
    assert math.hypot(*near[:2]) == pytest.approx(CONFIG.max_speed_mps)


@pytest.mark.parametrize("turned", [0.2, -0.2])
def test_parallel_goes_back_to_the_bearing_of_the_confirmation(turned):
    """The target was north and is now to the right of that: east of it is where the vehicle must go, and back."""
    aside = wish(mode=FollowMode.PARALLEL, azimuth_rad=turned).velocity_ned_mps
    tangential = aside[1] * math.cos(turned) - aside[0] * math.sin(turned)
    assert tangential == pytest.approx(CONFIG.range_gain_ps * 15.0 * turned)
    assert aside[0] * math.cos(turned) + aside[1] * math.sin(turned) == pytest.approx(0.0, abs=1e-9)
    assert wish(mode=FollowMode.PARALLEL).velocity_ned_mps == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_parallel_moves_along_with_all_of_the_targets_velocity():
    seen = wish(mode=FollowMode.PARALLEL, azimuth_rate_rps=2 / 15, log_size_rate_ps=-0.1)
    assert seen.velocity_ned_mps == pytest.approx((1.5, 2.0, 0.0))


def test_a_bearing_far_off_is_come_back_to_the_short_way_and_no_faster_than_a_circle_allows():
    speed = circle_speed_mps(15.0, CONFIG)
    for turned, sign in ((3.0, 1), (-3.0, -1)):
        north, east, _ = wish(mode=FollowMode.PARALLEL, azimuth_rad=turned).velocity_ned_mps
        assert math.hypot(north, east) == pytest.approx(speed)
        assert east * math.cos(turned) - north * math.sin(turned) == pytest.approx(sign * speed)


@pytest.mark.parametrize("speed", [2.0, -2.0, 1.0])
def test_orbit_goes_clockwise_seen_from_above_where_its_speed_is_positive(speed):
    """South of the target, clockwise is to the west."""
    config = replace(CONFIG, orbit_speed_mps=speed)
    assert wish(mode=FollowMode.ORBIT, config=config).velocity_ned_mps == pytest.approx((0.0, -speed, 0.0))


def test_orbit_goes_along_with_the_target():
    both = wish(mode=FollowMode.ORBIT, azimuth_rate_rps=3 / 15).velocity_ned_mps
    assert both == pytest.approx((0.0, 3.0 - CONFIG.orbit_speed_mps, 0.0))


@pytest.mark.parametrize("radius", [4.0, 8.0, 15.0, 60.0])
def test_a_circle_is_flown_no_faster_than_lean_and_yaw_rate_allow(radius):
    speed = circle_speed_mps(radius, CONFIG)
    assert speed**2 / radius <= CONFIG.orbit_acceleration_mps2 + 1e-9
    assert speed / radius <= CONFIG.orbit_yaw_frac * CONFIG.max_yaw_rate_rps + 1e-9
    assert speed <= CONFIG.max_speed_mps
    slow_turn = replace(CONFIG, orbit_yaw_frac=0.05)
    assert circle_speed_mps(radius, slow_turn) == pytest.approx(
        min(speed, radius * 0.05 * CONFIG.max_yaw_rate_rps), rel=1e-9
    )
    assert circle_speed_mps(-1.0, CONFIG) == 0.0


@pytest.mark.parametrize("mode", [FollowMode.PARALLEL, FollowMode.ORBIT])
def test_near_the_smallest_distance_nothing_but_backing_off_is_left(mode):
    """A target that walks into the circle."""
    near = wish(mode=mode, azimuth_rad=0.5, log_size=-2.5 + math.log(15 / 2.9)).velocity_ned_mps
    assert near[0] < -0.5
    assert near[1] / near[0] == pytest.approx(math.tan(0.5), abs=0.02)


@pytest.mark.parametrize("mode", [FollowMode.PARALLEL, FollowMode.ORBIT])
def test_a_coasting_vehicle_circles_nothing(mode):
    still = wish(mode=mode, coasting=True, azimuth_rad=0.3).velocity_ned_mps
    assert still == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_a_standoff_that_is_being_led_is_flown_along_with():
    nearer = replace(confirmed(), standoff_goal_m=10.0)
    assert wish(confirmation=nearer).velocity_ned_mps[0] == pytest.approx(CONFIG.standoff_speed_mps)
    further = replace(confirmed(), standoff_goal_m=20.0)
    assert wish(confirmation=further).velocity_ned_mps[0] == pytest.approx(-CONFIG.standoff_speed_mps)


@pytest.mark.parametrize("distance", [3.5, 5.0, 8.0])
def test_what_is_across_could_be_stopped_too(distance):
    """It is towards the target as soon as the target moves on."""
    close = replace(confirmed(FollowMode.PARALLEL), range_m=distance / math.cos(DOWN), standoff_m=distance)
    _, east, _ = wish(confirmation=replace(close, ground_factor=None), azimuth_rate_rps=1.5).velocity_ned_mps
    margin = east * CONFIG.response_s + east**2 / CONFIG.braking_mps2
    assert margin == pytest.approx(distance - CONFIG.min_distance_m)

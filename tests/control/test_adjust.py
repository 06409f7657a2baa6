"""What an operator may change while following."""

import math
from dataclasses import replace

import pytest

from control.adjust import change_mode, change_standoff
from control.modes import ConfirmError, FollowMode
from control.ranging import lead_range

from .follow_rig import CONFIG, DOWN, VEHICLE, confirmed, target


def led(confirmation, seconds):
    for _ in range(round(seconds / 0.05)):
        confirmation = confirmation.led(0.05, CONFIG)
    return confirmation


@pytest.mark.parametrize("goal", [10.0, 20.0])
def test_a_new_standoff_is_led_to_at_its_speed_and_not_beyond(goal):
    begun = change_standoff(confirmed(), goal, CONFIG)
    half = led(begun, 2.5)
    assert abs(half.standoff_m - 15.0) == pytest.approx(2.5 * CONFIG.standoff_speed_mps)
    there = led(begun, 5.5)
    assert (there.standoff_m, there.standoff_goal_m) == (goal, None)
    assert there.standoff_rate_mps(CONFIG) == 0.0
    assert begun.standoff_rate_mps(CONFIG) == pytest.approx(math.copysign(CONFIG.standoff_speed_mps, goal - 15.0))
    assert led(confirmed(), 1.0) == confirmed()


@pytest.mark.parametrize("goal", [3.5, 81.0, math.nan, -5.0])
def test_no_standoff_is_led_to_where_none_may_be_held(goal):
    with pytest.raises(ConfirmError, match=r"standoff must be from 3\.6 to 80 m"):
        change_standoff(confirmed(), goal, CONFIG)


def test_spotlight_has_no_standoff_to_change():
    with pytest.raises(ConfirmError, match="spotlight holds no distance"):
        change_standoff(confirmed(FollowMode.SPOTLIGHT), 10.0, CONFIG)


def test_another_mode_begins_from_this_moment_and_keeps_what_is_known():
    before = lead_range(confirmed(distance_m=20.0, standoff_m=12.0), target(log_size=-2.3), VEHICLE, 0.05, CONFIG)
    moving = replace(VEHICLE, velocity_ned_mps=(7.0, 0.0, 0.0), height_m=8.0)
    after = change_mode(before, FollowMode.PARALLEL, target(azimuth_rad=0.7), moving, 20.0, CONFIG)
    assert (after.mode, after.azimuth_rad, after.t_s) == (FollowMode.PARALLEL, 0.7, 20.0)
    kept = ("log_size", "range_m", "confirmed_range_m", "standoff_m", "height_m", "ground_factor")
    assert all(getattr(after, name) == getattr(before, name) for name in kept)
    braking_s = CONFIG.response_s + 7.0 / CONFIG.braking_mps2 / 2
    assert after.position_ned_m == pytest.approx((3.0 + 7.0 * braking_s, 4.0, -5.0))


def test_a_way_to_another_standoff_ends_with_the_mode():
    going = change_standoff(confirmed(), 10.0, CONFIG)
    assert change_mode(going, FollowMode.ORBIT, target(), VEHICLE, 20.0, CONFIG).standoff_goal_m is None


def test_from_spotlight_the_distance_is_found_as_at_a_confirmation():
    place = confirmed(FollowMode.SPOTLIGHT)
    near = target(elevation_rad=-math.atan2(5, 12), log_size=-2.2)
    after = change_mode(place, FollowMode.FOLLOW, near, VEHICLE, 20.0, CONFIG)
    assert (after.standoff_m, after.log_size) == pytest.approx((12.0, -2.2))
    typed = change_mode(place, FollowMode.ORBIT, near, VEHICLE, 20.0, CONFIG, distance_m=18.0)
    assert typed.standoff_m == 18.0
    with pytest.raises(ConfirmError, match="distance unknown"):
        change_mode(place, FollowMode.FOLLOW, target(elevation_rad=0.0), VEHICLE, 20.0, CONFIG)
    assert change_mode(place, FollowMode.SPOTLIGHT, target(elevation_rad=DOWN), VEHICLE, 20.0, CONFIG).t_s == 20.0

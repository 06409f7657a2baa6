"""What a confirmation remembers, and what it refuses."""

import math
from dataclasses import replace

import pytest

from control.modes import ConfirmError, FollowMode, confirm, ground_distance_m, sure_ground_m
from control.motion import distance_m, target_motion

from .follow_rig import CONFIG, STILL, VEHICLE, confirmed, target


def test_distance_comes_from_height_and_depression():
    assert ground_distance_m(target(), VEHICLE, CONFIG) == pytest.approx(15.0)
    assert confirmed().standoff_m == pytest.approx(15.0)
    assert confirmed().range_m == pytest.approx(math.hypot(15, 5))
    assert ground_distance_m(target(elevation_rad=0.1), VEHICLE, CONFIG) is None
    assert ground_distance_m(target(), replace(VEHICLE, height_m=-1.0), CONFIG) is None


@pytest.mark.parametrize("distance", [10.0, 16.0, 25.0])
@pytest.mark.parametrize(("length", "width", "height"), [(0.5, 0.5, 1.75), (4.2, 1.8, 1.5), (1.8, 4.2, 1.5)])
def test_the_confirmed_distance_is_that_of_where_the_target_stands(distance, length, width, height):
    """A block on level ground, 9 m below: its upper far and lower near edge bound the box."""
    above, below = math.atan2(9.0 - height, distance + length / 2), math.atan2(9.0, distance - length / 2)
    tall = below - above
    wide = width / math.hypot(distance, 9.0)
    block = target(
        elevation_rad=-(above + below) / 2, log_size=math.log(math.sqrt(wide * tall)), log_aspect=math.log(wide / tall)
    )
    vehicle = replace(VEHICLE, height_m=9.0)
    confirmation = confirm(FollowMode.FOLLOW, block, vehicle, 10.0, CONFIG)
    assert confirmation.standoff_m == pytest.approx(distance, rel=0.10)
    assert ground_distance_m(replace(block, log_aspect=None), vehicle, CONFIG) > confirmation.standoff_m
    told = target_motion(confirmation, block, STILL, CONFIG, sure_ground_m(block, vehicle, CONFIG))
    assert (told.distance_m, told.nearest_m) == pytest.approx((confirmation.standoff_m,) * 2)


def test_typed_distance_wins_and_standoff_may_differ():
    typed = confirmed(distance_m=20.0, standoff_m=12.0)
    assert (typed.standoff_m, distance_m(typed, target())) == pytest.approx((12.0, 20.0))


def test_confirmation_is_refused_where_the_distance_is_unknown_or_absurd():
    level = target(elevation_rad=0.0)
    with pytest.raises(ConfirmError, match="distance unknown"):
        confirm(FollowMode.FOLLOW, level, VEHICLE, 10.0, CONFIG)
    with pytest.raises(ConfirmError, match=r"standoff must be from 3\.6 to 80 m, not 3\.0 m"):
        confirmed(standoff_m=3.0)
    with pytest.raises(ConfirmError, match="distance must be"):
        confirmed(distance_m=math.nan)
    assert confirm(FollowMode.SPOTLIGHT, level, VEHICLE, 10.0, CONFIG).mode is FollowMode.SPOTLIGHT


def test_twice_the_size_is_half_the_range():
    assert distance_m(confirmed(), target(log_size=-2.5 + math.log(2))) == pytest.approx(7.5)
    assert math.isfinite(distance_m(confirmed(), target(log_size=-1e6)))

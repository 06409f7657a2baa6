"""The height that is held: the vehicle's own, or that above the target."""

import math
from dataclasses import replace

import pytest

from control.config import Altitude
from control.modes import FollowMode, confirm
from control.ranging import lead_range

from .follow_rig import CONFIG, VEHICLE, confirmed, target, wish

RELATIVE = replace(CONFIG, altitude=Altitude.RELATIVE)


def down_mps(north_m=15.0, up_m=-5.0, rise_mps=0.0, own_down_mps=0.0, config=RELATIVE, vehicle=VEHICLE, **changes):
    """The wish for a target so far ahead and above, which rises so fast; by plane geometry alone."""
    slant = math.hypot(north_m, up_m)
    relative = rise_mps + own_down_mps
    seen = {
        "elevation_rad": math.atan2(up_m, north_m),
        "elevation_rate_rps": relative * north_m / slant**2,
        "log_size": -2.5 + math.log(math.hypot(15.0, 5.0) / slant),
        "log_size_rate_ps": -relative * up_m / slant**2,
    } | changes
    confirmation = confirmed(config=config)
    return wish(vehicle, (0.0, 0.0, own_down_mps), config=config, confirmation=confirmation, **seen).velocity_ned_mps[2]


def test_at_the_height_of_the_confirmation_nothing_is_asked():
    assert down_mps() == pytest.approx(0.0, abs=1e-9)
    assert confirmed(config=RELATIVE).above_m == pytest.approx(5.0)
    assert confirmed().above_m is None


@pytest.mark.parametrize("north", [8.0, 15.0, 25.0])
def test_a_target_that_has_climbed_raises(north):
    """Whatever its distance by now: half a metre higher, so much up."""
    assert down_mps(north, up_m=-4.5) == pytest.approx(-0.5 * CONFIG.height_gain_ps)
    assert down_mps(north, up_m=-5.5) == pytest.approx(0.5 * CONFIG.height_gain_ps)
    assert down_mps(north, up_m=-0.5) == -CONFIG.max_vertical_mps
    assert down_mps(north, up_m=-12.0) == CONFIG.max_vertical_mps


@pytest.mark.parametrize("own", [0.0, -0.3, 0.4])
def test_a_target_that_is_climbing_is_gone_along_with(own):
    """Its own climb is told from the vehicle's."""
    assert down_mps(rise_mps=0.3, own_down_mps=own) == pytest.approx(-0.3 * CONFIG.target_velocity_gain)


@pytest.mark.parametrize(
    "doubt", [{"size_trust": 0.2}, {"elevation_trust": 0.2}, {"confidence": 0.3}], ids=lambda d: next(iter(d))
)
def test_a_guess_moves_nothing(doubt):
    assert down_mps(up_m=-3.0, **doubt) == 0.0
    assert down_mps(up_m=-3.0) < 0.0


def test_held_height_does_not_care_for_the_target():
    assert down_mps(up_m=-3.0, config=CONFIG) == 0.0
    assert down_mps(config=CONFIG, vehicle=replace(VEHICLE, height_m=5.5)) == pytest.approx(0.4)


def test_a_target_that_need_not_stand_on_the_ground_is_ranged_by_its_size_alone():
    relative = confirmed(config=RELATIVE)
    assert relative.ground_factor is None
    climbed = target(elevation_rad=-0.15)
    assert lead_range(relative, climbed, VEHICLE, 0.05, RELATIVE) == relative
    far = replace(RELATIVE, max_distance_m=80.0)
    unknown = confirm(FollowMode.SPOTLIGHT, target(elevation_rad=0.1), VEHICLE, 10.0, far)
    assert unknown.above_m is None

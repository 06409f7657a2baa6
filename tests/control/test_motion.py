"""How the target moves over ground, and what of that is believed."""

import math
from dataclasses import replace

import pytest

from control.config import ControlConfig
from control.follow import FollowState, follow_request
from control.motion import Belief, believe, fade, target_motion

from .follow_rig import CAMERA, CONFIG, DOWN, STILL, VEHICLE, confirmed, ground_motion, target


def test_what_the_target_does_is_believed_as_far_as_it_is_known():
    sure = target_motion(confirmed(), target(azimuth_rate_rps=0.2), STILL, CONFIG)
    unsure = target_motion(confirmed(), target(azimuth_rate_rps=0.2, azimuth_rate_std_rps=2.0), STILL, CONFIG)
    assert sure.tangential_mps == pytest.approx(3.0)
    assert unsure.tangential_mps < 0.5
    assert fade(0.0, 1.0) == 1.0
    assert fade(2.0, 2.0) == 0.5


def test_a_target_that_drops_is_not_taken_for_one_that_leaves():
    """Height changes alone: range and depression both change, ground distance does not."""
    rate = 0.1
    opening = math.tan(DOWN) * rate * -1
    motion = target_motion(confirmed(), target(elevation_rate_rps=rate, log_size_rate_ps=opening), STILL, CONFIG)
    assert motion.radial_mps == pytest.approx(0.0, abs=1e-9)


def test_size_is_believed_only_so_far_from_what_height_and_depression_say():
    half = -2.5 + math.log(0.5)
    assert target_motion(confirmed(), target(log_size=half), STILL, CONFIG).distance_m == pytest.approx(30.0)
    covered, grown = ground_motion(log_size=half), ground_motion(log_size=-2.5 - math.log(0.5))
    assert 15.0 < covered.distance_m < 15.0 * 1.25
    assert 15.0 / 1.25 < grown.distance_m < 15.0
    assert (covered.nearest_m, grown.nearest_m) == pytest.approx((15.0, 7.5))
    assert ground_motion(log_size=-2.55).distance_m == pytest.approx(15.0 * math.exp(0.05))
    blind = ground_motion(log_size=half, size_trust=0.0)
    assert 15.0 < blind.distance_m < covered.distance_m


def test_the_rate_of_size_is_believed_only_so_far_from_that_of_depression():
    """16 m/s away, says the size; standing, says the depression."""
    slack = CONFIG.size_rate_tolerance_ps
    assert target_motion(confirmed(), target(log_size_rate_ps=-1.0), STILL, CONFIG).radial_mps == pytest.approx(15.0)
    assert ground_motion(log_size_rate_ps=-1.0).radial_mps == pytest.approx(15.0 * slack)
    assert ground_motion(log_size_rate_ps=1.0).radial_mps == pytest.approx(-15.0 * slack)
    assert ground_motion(log_size_rate_ps=-1.0, size_trust=0.0).radial_mps == pytest.approx(0.0)
    # Leaving at 1.5 m/s over level ground: the same from depression alone.
    rate = 1.5 * 5.0 / (15.0**2 + 5.0**2)
    leaving = ground_motion(elevation_rate_rps=rate, log_size_rate_ps=0.0, size_trust=0.0)
    assert leaving.radial_mps == pytest.approx(1.5)


def test_a_range_that_the_ground_has_led_does_not_count_as_room():
    """Uphill the ground says 30 m of what by its size has stayed 15 m away: kept clear of as if it were nearer."""
    led = replace(confirmed(), range_m=2 * confirmed().range_m)
    motion = target_motion(led, target(), STILL, CONFIG)
    assert (motion.distance_m, motion.nearest_m) == pytest.approx((30.0, 15.0))
    nearer = target_motion(replace(confirmed(), range_m=confirmed().range_m / 2), target(), STILL, CONFIG)
    assert (nearer.distance_m, nearer.nearest_m) == pytest.approx((7.5, 7.5))


def moving(radial_mps, sure_radial_mps=math.inf):
    return replace(ground_motion(), radial_mps=radial_mps, sure_radial_mps=sure_radial_mps)


def test_the_velocity_of_a_covered_target_is_kept_then_given_up():
    belief = believe(None, moving(1.5), 1.0, 10.0, CONFIG)
    assert belief == Belief(10.0, 1.5, 0.0, 0.0)
    history = []
    for n in range(80):
        belief = believe(belief, moving(-9.0, -9.0), 0.0, 10.05 + n * 0.05, CONFIG)
        history.append(belief.radial_mps)
    assert history[18] == pytest.approx(1.5)
    assert history[79] == pytest.approx(1.5 * math.exp(-(4.0 - CONFIG.blind_hold_s) / CONFIG.blind_fade_s), rel=0.1)
    whole = believe(belief, moving(belief.radial_mps), 1.0, belief.t_s + 0.05, CONFIG)
    assert whole.blind_s == 0.0


def test_nothing_on_the_ground_jumps_to_another_velocity():
    belief = believe(Belief(10.0, 1.0, 0.0, 0.0), moving(9.0), 1.0, 10.1, CONFIG)
    assert belief.radial_mps == pytest.approx(1.0 + 0.1 * CONFIG.target_acceleration_mps2)
    assert believe(belief, moving(-9.0), 1.0, 10.2, CONFIG).radial_mps == pytest.approx(1.0)
    assert believe(Belief(10.0, 1.0, 0.0, 0.0), moving(9.0), 1.0, 9.0, CONFIG).radial_mps == 1.0


def test_what_surely_comes_nearer_is_believed_at_once():
    coming = believe(Belief(10.0, 4.0, 0.0, 0.0), moving(-6.0, -5.0), 1.0, 10.05, CONFIG)
    assert coming.radial_mps == -5.0 + CONFIG.approach_margin_mps
    rate = 5.0 / 15.0
    size = {"log_size_rate_ps": rate * math.cos(DOWN) ** 2}
    depression = {"elevation_rate_rps": -rate * math.sin(-DOWN) * math.cos(DOWN)}
    assert ground_motion(**size, **depression).sure_radial_mps == pytest.approx(-5.0)
    assert ground_motion(log_size_rate_ps=rate).sure_radial_mps == pytest.approx(0.0)  # the size alone
    assert ground_motion(**depression).sure_radial_mps > -1.0  # the depression alone


@pytest.mark.parametrize(("trust", "elevation_trust", "speed_mps"), [(1.0, 1.0, 2.0), (0.0, 1.0, 2.0), (0.0, 0.0, 0.0)])
def test_depression_alone_tells_the_velocity_where_it_is_whole(trust, elevation_trust, speed_mps):
    """The target has begun to leave at 2 m/s; both size and depression say so."""
    rate = 2.0 / 15.0
    leaving = target(
        log_size_rate_ps=-rate * math.cos(DOWN) ** 2, elevation_rate_rps=rate * math.sin(-DOWN) * math.cos(DOWN),
        size_trust=trust, elevation_trust=elevation_trust,
    )  # fmt: skip
    state, now = FollowState.at_rest(10.0), 10.0
    _, state = follow_request(confirmed(), target(), VEHICLE, CAMERA, now, state, ControlConfig())
    for _ in range(20):
        now += 0.05
        _, state = follow_request(confirmed(), leaving, VEHICLE, CAMERA, now, state, ControlConfig())
    assert state.belief.radial_mps == pytest.approx(speed_mps, abs=0.01)


def test_what_the_target_does_is_gone_along_with_once_it_keeps_at_it():
    config, now, believed = replace(CONFIG, target_acceleration_mps2=20.0), 10.0, Belief(10.0, 0.0, 0.0, 0.0)
    for _ in range(40):
        now += 0.05
        believed = believe(believed, moving(2.0), 1.0, now, config)
    assert believed.radial_mps == pytest.approx(2.0)
    assert believed.steady_mps == pytest.approx(2.0 * (1 - math.exp(-2.0 / config.target_velocity_lag_s)), rel=0.02)


def test_an_approach_is_made_ready_for_as_it_is_now_not_as_the_filter_had_it():
    """At 8 m/s from 16.8 m, and 0.6 s later 12 m away: the rate is still that of 16.8 m."""
    late = target_motion(replace(confirmed(), range_m=12.0 / math.cos(DOWN), ground_factor=None),
        target(log_size_rate_ps=8.0 / 16.8), STILL, CONFIG)  # fmt: skip
    assert late.coming_mps == pytest.approx(-8.0, rel=0.07)
    assert late.radial_mps > -6.0
    assert ground_motion(log_size_rate_ps=-0.1).coming_mps == ground_motion(log_size_rate_ps=-0.1).radial_mps


def test_what_is_gone_along_with_is_not_drawn_towards_an_approach_by_noise():
    """Half of the noise is taken for an approach at once, as far as safety goes; the mean is not to follow that."""
    believed, now = Belief(10.0, 0.0, 0.0, 0.0), 10.0
    for n in range(400):
        now += 0.05
        noise = 3.0 if n % 2 else -3.0
        believed = believe(believed, moving(noise, noise), 1.0, now, CONFIG)
    assert believed.steady_mps == pytest.approx(0.0, abs=0.1)

"""Why a vehicle slows: stopping distance, time to collision, a guess, the picture."""

import itertools
import math
from dataclasses import replace

import pytest

from control.closing import confidence_factor, stoppable_speed_mps
from control.field_of_view import view_acceleration_mps2
from control.modes import FollowMode
from control.motion import target_motion

from .follow_rig import CAMERA, CONFIG, VEHICLE, confirmed, target, wish


@pytest.mark.parametrize("margin", [0.5, 3.0, 12.0, 50.0])
def test_closing_speed_is_what_can_still_be_stopped(margin):
    fresh = target(measured_t_s=target().t_s)
    v = stoppable_speed_mps(margin, fresh, VEHICLE, CONFIG)
    assert v * (CONFIG.response_s + v / CONFIG.braking_mps2) == pytest.approx(margin)
    for nothing in (0.0, -5.0):
        assert stoppable_speed_mps(nothing, fresh, VEHICLE, CONFIG) == 0.0


def test_what_is_seen_late_or_brakes_softly_is_stopped_from_less():
    """A quarter of a second of latency; an autopilot that answers 0.4 s later and brakes at 2.5 m/s² at most."""
    late, soft = target(measured_t_s=target().t_s - 0.25), replace(VEHICLE, braking_mps2=2.5, late_s=0.4)
    v = stoppable_speed_mps(9.0, late, soft, CONFIG)
    assert v * (CONFIG.response_s + 0.25 + 0.4 + v / 2.5) == pytest.approx(9.0)


def test_never_closer_than_the_smallest_distance():
    near = wish(log_size=-2.5 + math.log(15 / 2.9), own=(10.0, 0.0, 0.0))
    assert near.velocity_ned_mps[0] == 0.0
    assert "stopping distance" in near.limited_by


def test_brakes_when_a_collision_is_near():
    coming = wish(log_size=-2.9, log_size_rate_ps=0.5, own=(6.0, 0.0, 0.0))
    assert coming.velocity_ned_mps[0] <= 0.0
    assert coming.brake
    assert "time to collision" in wish(log_size_rate_ps=0.4, own=(12.0, 0.0, 0.0)).limited_by
    # A size rate that is mostly noise does not brake.
    assert not wish(log_size_rate_ps=0.5, log_size_rate_std_ps=0.4).brake


def test_closing_faster_than_can_be_stopped_brakes():
    assert wish(own=(7.0, 0.0, 0.0), log_size=-2.0).brake
    assert not wish(own=(1.0, 0.0, 0.0)).brake


@pytest.mark.parametrize(("changes", "coasting"), [({}, True), ({"confidence": 0.39}, False)])
def test_no_closing_while_coasting_or_unsure(changes, coasting):
    far = wish(log_size=-3.0, coasting=coasting, **changes)
    assert far.velocity_ned_mps[0] <= 1e-12
    assert far.limited_by
    near = wish(log_size=-2.2, coasting=coasting, **changes)
    assert near.velocity_ned_mps[0] < 0


def test_coasting_keeps_up_but_neither_closes_in_nor_speeds_up():
    """The target left at 3 m/s when last seen."""
    leaving = {"log_size": -3.0, "log_size_rate_ps": -0.1}
    keeping = wish(own=(1.5, 0.0, 0.0), coasting=True, **leaving)
    assert wish(own=(1.5, 0.0, 0.0), **leaving).velocity_ned_mps[0] > 2.0
    assert keeping.velocity_ned_mps[0] == pytest.approx(1.5)
    faster = wish(own=(5.0, 0.0, 0.0), coasting=True, log_size=-3.0, log_size_rate_ps=0.2)
    assert faster.velocity_ned_mps[0] == pytest.approx(target_motion(
        confirmed(), target(log_size=-3.0, log_size_rate_ps=0.2), (5.0, 0.0, 0.0), CONFIG, 15.0
    ).radial_mps)  # fmt: skip
    assert 0.0 < faster.velocity_ned_mps[0] < 5.0


def test_a_weak_score_slows_smoothly():
    factors = [confidence_factor(c / 20, CONFIG) for c in range(21)]
    assert factors == sorted(factors)
    assert factors[0] == 0.0
    assert factors[-1] == 1.0
    assert max(b - a for a, b in itertools.pairwise(factors)) < 0.2
    assert abs(wish(log_size=-2.3, confidence=0.3).velocity_ned_mps[0]) < abs(wish(log_size=-2.3).velocity_ned_mps[0])


def test_acceleration_is_bounded_by_what_the_picture_has_room_for():
    """Room above: the nose may dip until the target reaches the upper margin; below: the other way."""
    centred = math.radians(-15)
    low, high = view_acceleration_mps2(centred, CAMERA, CONFIG)
    room = CAMERA.vfov_rad * (0.5 - CONFIG.view_margin_frac)
    assert (low, high) == pytest.approx((-9.81 * math.tan(room), 9.81 * math.tan(room)))
    _, high_up = view_acceleration_mps2(centred + 0.2, CAMERA, CONFIG)
    assert high_up == pytest.approx(9.81 * math.tan(room - 0.2))
    low_down, _ = view_acceleration_mps2(centred - 0.2, CAMERA, CONFIG)
    assert low_down == pytest.approx(-9.81 * math.tan(room - 0.2))
    least = CONFIG.min_acceleration_mps2
    assert view_acceleration_mps2(1.0, CAMERA, CONFIG)[1] == least
    assert view_acceleration_mps2(-1.5, CAMERA, CONFIG)[0] == -least


@pytest.mark.parametrize("mode", [m for m in FollowMode if m.holds_distance])
@pytest.mark.parametrize("approach", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("distance", [4.0, 6.0, 9.0])
def test_together_they_never_close_in_faster_than_can_be_stopped(mode, approach, distance):
    """margin = v * response + v² / (2 a) with a constant deceleration needs less; the law is the stricter v² / a."""
    size = -2.5 + math.log(math.hypot(15, 5) / math.hypot(distance, 5))
    near = wish(
        mode=mode, confirmation=replace(confirmed(mode), standoff_m=3.6), log_size=size,
        elevation_rad=-math.atan2(5, distance), log_size_rate_ps=approach / distance, own=(2.0, 0.0, 0.0),
        elevation_rate_rps=0.0, config=CONFIG,
    )  # fmt: skip
    own = near.velocity_ned_mps[0]
    motion = target_motion(
        confirmed(mode), target(log_size=size, elevation_rad=-math.atan2(5, distance),
        log_size_rate_ps=approach / distance), (2.0, 0.0, 0.0), CONFIG, distance,
    )  # fmt: skip
    closing = own - min(motion.radial_mps, 0.0)
    margin = distance - CONFIG.min_distance_m
    assert closing <= 1e-9 or closing * CONFIG.response_s + closing**2 / CONFIG.braking_mps2 <= margin + 1e-6


@pytest.mark.parametrize("mode", [m for m in FollowMode if m.holds_distance])
@pytest.mark.parametrize("limit", ["coasting", "confidence", "collision", "too near"])
def test_no_mode_closes_in_where_none_may(mode, limit):
    changes = {
        "coasting": {"coasting": True, "log_size": -3.0},
        "confidence": {"confidence": 0.35, "log_size": -3.0},
        "collision": {"log_size_rate_ps": 0.4, "log_size": -3.0},
        "too near": {"log_size": -2.5 + math.log(15 / 2.9)},
    }[limit]
    for azimuth in (0.0, 0.4):
        north, east, _ = wish(mode=mode, azimuth_rad=azimuth, **changes).velocity_ned_mps
        assert north * math.cos(azimuth) + east * math.sin(azimuth) <= 1e-9


def test_a_collision_less_than_three_seconds_away_brakes_and_one_further_off_does_not():
    for rate in (0.2, 0.3, 0.36, 0.5):
        assert wish(log_size_rate_ps=rate, log_size=-2.5).brake == (1 / rate < CONFIG.time_to_collision_s)

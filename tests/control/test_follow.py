"""The laws one by one: signs, bounds, and what each limit is there for."""

import itertools
import math
from dataclasses import replace

import pytest

from control.camera import CameraModel
from control.config import ControlConfig, FollowConfig, ShapingConfig
from control.follow import (
    FollowState,
    confidence_factor,
    follow,
    follow_request,
    follow_wish,
    spotlight,
    stoppable_speed_mps,
    view_acceleration_mps2,
    yaw_rate_rps,
)
from control.limits import ShapeState, Wish, after_setpoint, priming_request, shape, zero_request
from control.modes import ConfirmError, FollowMode, confirm, ground_distance_m, sure_ground_m
from control.motion import Belief, believe, distance_m, fade, target_motion
from control.types import TargetState, VehicleState

CONFIG = FollowConfig()
CAMERA = CameraModel.from_hfov(640, 480, math.radians(80), mount_rpy_rad=(0.0, math.radians(-15), 0.0))
VEHICLE = VehicleState(attitude_t_s=10.0, position_t_s=10.0, position_ned_m=(3.0, 4.0, -5.0), height_m=5.0)
STILL = (0.0, 0.0, 0.0)
DOWN = -math.atan2(5.0, 15.0)  # the target is on the ground, 15 m ahead


def target(**changes):
    base = TargetState(
        t_s=10.0, azimuth_rad=0.0, azimuth_rate_rps=0.0, elevation_rad=DOWN, elevation_rate_rps=0.0, log_size=-2.5,
        log_size_rate_ps=0.0, azimuth_std_rad=0.01, azimuth_rate_std_rps=0.0, log_size_std=0.01, confidence=1.0,
        measured_t_s=10.0, rejections_in_a_row=0,
    )  # fmt: skip
    return replace(base, **changes)


def confirmed(mode=FollowMode.FOLLOW, **kwargs):
    return confirm(mode, target(), VEHICLE, 10.0, CONFIG, **kwargs)


def wish(vehicle=VEHICLE, own=STILL, coasting=False, config=CONFIG, **changes):
    return follow(confirmed(), target(**changes), vehicle, CAMERA, config, own, coasting=coasting)


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


def test_spotlight_comes_back_to_its_place_and_height():
    place = confirmed(FollowMode.SPOTLIGHT)
    blown = replace(VEHICLE, position_ned_m=(4.0, 3.0, -6.0), height_m=6.0)
    north, east, down = spotlight(place, target(), blown, CAMERA, CONFIG).velocity_ned_mps
    assert north < 0 < east
    assert down > 0
    far = replace(VEHICLE, position_ned_m=(103.0, 4.0, -5.0))
    speed = math.hypot(*spotlight(place, target(), far, CAMERA, CONFIG).velocity_ned_mps[:2])
    assert speed == pytest.approx(CONFIG.max_station_speed_mps)


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


@pytest.mark.parametrize("margin", [0.5, 3.0, 12.0, 50.0])
def test_closing_speed_is_what_can_still_be_stopped(margin):
    v = stoppable_speed_mps(margin, CONFIG)
    assert v * (CONFIG.response_s + v / CONFIG.braking_mps2) == pytest.approx(margin)
    assert stoppable_speed_mps(0.0, CONFIG) == stoppable_speed_mps(-5.0, CONFIG) == 0.0


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


def ground_motion(ground_m=15.0, own=STILL, **changes):
    return target_motion(confirmed(), target(**changes), own, CONFIG, ground_m)


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


def test_a_shrinking_box_at_the_same_depression_is_hardly_chased():
    half = -2.5 + math.log(0.5)
    flat = replace(confirmed(), ground_factor=None)
    chased = follow(flat, target(log_size=half, log_size_rate_ps=-0.5), VEHICLE, CAMERA, CONFIG, STILL)
    assert chased.velocity_ned_mps[0] == pytest.approx(CONFIG.max_speed_mps)
    assert wish(log_size=half, size_trust=0.0).velocity_ned_mps[0] < 0.5


def moving(radial_mps, sure_radial_mps=math.inf):
    return replace(ground_motion(), radial_mps=radial_mps, sure_radial_mps=sure_radial_mps)


def test_the_velocity_of_a_covered_target_is_kept_then_given_up():
    belief = believe(None, moving(1.5), 1.0, 10.0, CONFIG)
    assert belief == Belief(10.0, 1.5)
    history = []
    for n in range(80):
        belief = believe(belief, moving(-9.0, -9.0), 0.0, 10.05 + n * 0.05, CONFIG)
        history.append(belief.radial_mps)
    assert history[18] == pytest.approx(1.5)
    assert history[79] == pytest.approx(1.5 * math.exp(-(4.0 - CONFIG.blind_hold_s) / CONFIG.blind_fade_s), rel=0.1)
    whole = believe(belief, moving(belief.radial_mps), 1.0, belief.t_s + 0.05, CONFIG)
    assert whole.blind_s == 0.0


def test_nothing_on_the_ground_jumps_to_another_velocity():
    belief = believe(Belief(10.0, 1.0), moving(9.0), 1.0, 10.1, CONFIG)
    assert belief.radial_mps == pytest.approx(1.0 + 0.1 * CONFIG.target_acceleration_mps2)
    assert believe(belief, moving(-9.0), 1.0, 10.2, CONFIG).radial_mps == pytest.approx(1.0)
    assert believe(Belief(10.0, 1.0), moving(9.0), 1.0, 9.0, CONFIG).radial_mps == 1.0


def test_what_surely_comes_nearer_is_believed_at_once():
    coming = believe(Belief(10.0, 4.0), moving(-6.0, -5.0), 1.0, 10.05, CONFIG)
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


def test_a_weak_score_slows_smoothly():
    factors = [confidence_factor(c / 20, CONFIG) for c in range(21)]
    assert factors == sorted(factors)
    assert factors[0] == 0.0
    assert factors[-1] == 1.0
    assert max(b - a for a, b in itertools.pairwise(factors)) < 0.2
    assert abs(wish(log_size=-2.3, confidence=0.3).velocity_ned_mps[0]) < abs(wish(log_size=-2.3).velocity_ned_mps[0])


def test_speed_and_height_are_bounded():
    fast = wish(azimuth_rate_rps=1.0, log_size=-2.9)
    assert math.hypot(*fast.velocity_ned_mps[:2]) == pytest.approx(CONFIG.max_speed_mps)
    assert "speed" in fast.limited_by
    low = wish(vehicle=replace(VEHICLE, height_m=1.0))
    assert low.velocity_ned_mps[2] == -CONFIG.max_vertical_mps
    high = wish(vehicle=replace(VEHICLE, height_m=5.5))
    assert high.velocity_ned_mps[2] == pytest.approx(0.5 * CONFIG.height_gain_ps)


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


def tick(state, now, **kwargs):
    return follow_request(confirmed(), target(), VEHICLE, CAMERA, now, state, ControlConfig(), **kwargs)


def test_requests_are_shaped_and_coasting_fades_them():
    further = math.log(math.hypot(15, 5) / math.hypot(25, 5))
    far = target(log_size=-2.5 + further, azimuth_rad=0.5, elevation_rad=-math.atan2(5, 25))
    state, now = FollowState.at_rest(10.0), 10.0
    requests = []
    for n in range(40):
        now += 0.05
        factor = 1.0 if n < 30 else 0.0
        request, state = follow_request(
            confirmed(), far, VEHICLE, CAMERA, now, state, ControlConfig(), velocity_factor=factor
        )
        requests.append(request)
    speeds = [math.hypot(*r.velocity_ned_mps) for r in requests]
    assert speeds[0] < 0.02
    assert speeds[29] > 1.5
    assert speeds[39] < speeds[29] - 1.0
    assert "coasting" in requests[-1].limited_by
    assert all(abs(b - a) <= 3.5 * 0.05 + 1e-9 for a, b in itertools.pairwise(speeds))


def test_spotlight_is_reached_through_the_confirmed_mode():
    place = confirmed(FollowMode.SPOTLIGHT)
    via = follow_wish(place, target(log_size=-3.0), VEHICLE, CAMERA, CONFIG, STILL)
    assert via.velocity_ned_mps == (0.0, 0.0, 0.0)


def test_own_velocity_is_lagged_like_the_rates_it_is_added_to():
    moving = replace(VEHICLE, velocity_ned_mps=(3.0, 0.0, 0.0))
    _, state = follow_request(confirmed(), target(), moving, CAMERA, 10.05, FollowState.at_rest(10.0), ControlConfig())
    assert state.own_velocity_ned_mps == (3.0, 0.0, 0.0)
    for n in range(12):
        _, state = follow_request(confirmed(), target(), VEHICLE, CAMERA, 10.1 + n * 0.05, state, ControlConfig())
    assert state.own_velocity_ned_mps[0] == pytest.approx(3.0 * math.exp(-0.6 / CONFIG.rate_lag_s))


SHAPING = ShapingConfig()


@pytest.mark.parametrize("brake", [False, True])
@pytest.mark.parametrize("aim", [(3.0, 0.0, 0.0), (0.2, -0.1, 0.05), (-5.0, 4.0, 1.0), (1e-3, 0.0, 0.0)])
def test_shaping_arrives_within_acceleration_and_jerk(aim, brake):
    state, now, before = ShapeState(0.0), 0.0, (0.0, 0.0, 0.0)
    top = SHAPING.braking_mps2 if brake else SHAPING.acceleration_mps2
    jerk = SHAPING.braking_jerk_mps3 if brake else SHAPING.jerk_mps3
    peak = 0.0
    for _ in range(120):
        now += 0.05
        _, state, names = shape(state, Wish(aim, 0.0, brake=brake), now, SHAPING)
        acceleration = tuple((b - a) / 0.05 for a, b in zip(before, state.velocity_ned_mps, strict=True))
        assert math.hypot(*acceleration) <= top + 1e-6
        before = state.velocity_ned_mps
        peak = max(peak, math.hypot(*before))
    assert state.velocity_ned_mps == pytest.approx(aim, abs=1e-6)
    assert peak <= math.hypot(*aim) * 1.1 + 0.02
    assert names == ()
    assert jerk > 0


def test_jerk_is_bounded_on_the_way_up():
    state, accelerations = ShapeState(0.0), [0.0]
    for n in range(10):
        _, state, names = shape(state, Wish((6.0, 0.0, 0.0), 0.0), 0.05 * (n + 1), SHAPING)
        accelerations.append(state.acceleration_ned_mps2[0])
    steps = [b - a for a, b in itertools.pairwise(accelerations)]
    assert max(steps) <= SHAPING.jerk_mps3 * 0.05 + 1e-9
    assert "acceleration" in names


def test_yaw_acceleration_is_bounded_and_named():
    request, state, names = shape(ShapeState(0.0), Wish((0.0, 0.0, 0.0), 1.0), 0.05, SHAPING)
    assert request.yaw_rate_rps == pytest.approx(math.radians(90) * 0.05)
    assert "yaw acceleration" in names
    assert request.limited_by == names
    back, _, _ = shape(state, Wish((0.0, 0.0, 0.0), -1.0), 0.1, SHAPING)
    assert back.yaw_rate_rps == pytest.approx(0.0)


def test_the_picture_bounds_acceleration_along_the_sight_only():
    tight = Wish((5.0, 5.0, 0.0), 0.0, sight_ne=(1.0, 0.0), sight_acceleration_mps2=(-0.5, 0.5))
    state = ShapeState(0.0)
    for n in range(10):
        _, state, names = shape(state, tight, 0.05 * (n + 1), SHAPING)
    assert state.acceleration_ned_mps2[0] == pytest.approx(0.5)
    assert state.acceleration_ned_mps2[1] > 1.0
    assert "field of view" in names
    braking = replace(tight, brake=True)
    for n in range(10):
        _, state, names = shape(state, braking, 0.55 + 0.05 * n, SHAPING)
    assert state.acceleration_ned_mps2[0] > 1.0


def test_after_a_gap_shaping_starts_from_rest_and_a_repeated_tick_changes_nothing():
    moving = ShapeState(0.0, (5.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0)
    request, _, _ = shape(moving, Wish((5.0, 0.0, 0.0), 1.0), 1.0, SHAPING)
    assert request.velocity_ned_mps[0] < 0.1
    assert request.yaw_rate_rps < 0.1
    request, _, _ = shape(moving, Wish((9.0, 0.0, 0.0), 1.0), 0.0, SHAPING)
    assert request.velocity_ned_mps == (5.0, 0.0, 0.0)


def test_shaping_goes_on_from_what_the_gate_really_sent():
    state = ShapeState(1.0, (2.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.5)
    assert after_setpoint(state, (2.0, 0.0, 0.0), 0.5) is state
    trimmed = after_setpoint(state, (0.0, 0.0, 0.0), 0.0)
    assert trimmed == ShapeState(1.0)


def test_zero_and_priming_requests():
    assert zero_request(3.0).velocity_ned_mps == (0.0, 0.0, 0.0)
    assert not zero_request(3.0).priming
    assert priming_request(3.0).priming

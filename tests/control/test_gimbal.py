"""Signs, bounds and stops of the gimbal's fast loop, and of the nose's slow one."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from control.config import GimbalConfig
from control.gimbal import GimbalLimits, GimbalRequest, GimbalState, Pointing, hand_over_rps
from control.types import TargetState, VehicleState

CONFIG = GimbalConfig()
GIMBAL = GimbalState(10.0, 0.0, 0.0, 0.0, 0.0, 0.0, 10.0, GimbalLimits(), ours=False)  # so that none is under way
VEHICLE = VehicleState()


def target(azimuth_deg: float = 0.0, elevation_deg: float = 0.0, azimuth_rate_rps: float = 0.0) -> TargetState:
    azimuth_rad, elevation_rad = math.radians(azimuth_deg), math.radians(elevation_deg)
    return TargetState(
        10.0, azimuth_rad, azimuth_rate_rps, elevation_rad, 0.0, -2.0, 0.0, 0.01, 0.02, 0.05, 0.9, 9.9, 0
    )


def settled(
    seen: TargetState, gimbal: GimbalState = GIMBAL, vehicle: VehicleState = VEHICLE, config: GimbalConfig = CONFIG
) -> GimbalRequest:
    """What is asked for once acceleration does not bound it any more."""
    pointing = Pointing(config)
    pointing.rest(9.0)
    for n in range(40):
        request = pointing.follow(seen, gimbal, vehicle, 9.05 + n * 0.05)
    return request


def test_signs_by_school_trigonometry() -> None:
    """A target 3 m to the right and 1 m below, 10 m ahead of a camera that looks straight ahead."""
    right_deg, up_deg = math.degrees(math.atan2(3, 10)), math.degrees(math.atan2(-1, math.hypot(3, 10)))
    request = settled(target(right_deg, up_deg))
    assert request.yaw_rate_rps > 0.1
    assert request.pitch_rate_rps < -0.1
    mirrored = settled(target(-right_deg, -up_deg))
    assert mirrored.yaw_rate_rps == pytest.approx(-request.yaw_rate_rps)
    assert mirrored.pitch_rate_rps == pytest.approx(-request.pitch_rate_rps)


def test_the_short_way_round_across_south() -> None:
    gimbal = replace(GIMBAL, yaw_rad=math.radians(175), relative_yaw_rad=0.0)
    assert settled(target(-175.0), gimbal).yaw_rate_rps > 0.1


def test_on_target_the_bearing_rate_is_fed_forward() -> None:
    moving = replace(GIMBAL, yaw_rate_rps=0.3)
    assert settled(target(azimuth_rate_rps=0.3), moving).yaw_rate_rps == pytest.approx(0.3, rel=0.02)


def test_rates_and_accelerations_are_bounded() -> None:
    pointing = Pointing(CONFIG)
    pointing.rest(9.95)
    first = pointing.follow(target(120.0, -80.0), GIMBAL, VEHICLE, 10.0)
    assert first.yaw_rate_rps == pytest.approx(CONFIG.max_acceleration_rps2 * 0.05)
    assert first.pitch_rate_rps == pytest.approx(-CONFIG.max_acceleration_rps2 * 0.05)
    assert settled(target(120.0)).yaw_rate_rps == pytest.approx(CONFIG.max_rate_rps)
    assert pointing.rest(10.05) == GimbalRequest(10.05)  # the stop is one step


def test_it_slows_towards_a_stop_and_never_pushes() -> None:
    limits = GimbalLimits(-1.0, 0.5, -1.5, 1.5)
    down = target(0.0, -85.0)
    half = settled(down, replace(GIMBAL, limits=limits, pitch_rad=-0.9)).pitch_rate_rps
    assert CONFIG.stop_gain_ps * -0.1 <= half < 0.0
    assert settled(down, replace(GIMBAL, limits=limits, pitch_rad=-1.0)).pitch_rate_rps == 0.0
    at_stop = replace(GIMBAL, limits=limits, yaw_rad=1.5, relative_yaw_rad=1.5)
    assert settled(target(120.0), at_stop).yaw_rate_rps == 0.0
    assert settled(target(0.0), at_stop).yaw_rate_rps < -0.1  # back it may go


def test_the_stop_turns_with_the_vehicle() -> None:
    limits = GimbalLimits(yaw_min_rad=-1.5, yaw_max_rad=1.5)
    at_stop = replace(GIMBAL, limits=limits, yaw_rad=1.5, relative_yaw_rad=1.5)
    turning = replace(VEHICLE, yaw_rate_rps=0.4)
    assert settled(target(120.0), at_stop, turning).yaw_rate_rps == pytest.approx(0.4)


def test_without_a_lock_the_rate_is_against_the_nose() -> None:
    free = replace(GIMBAL, limits=GimbalLimits(yaw_lock=False))
    assert settled(target(), free, replace(VEHICLE, yaw_rate_rps=0.4)).yaw_rate_rps == pytest.approx(-0.4)
    assert settled(target(), GIMBAL, replace(VEHICLE, yaw_rate_rps=0.4)).yaw_rate_rps == pytest.approx(0.0)


def test_without_a_yaw_axis_only_pitch_is_asked_for() -> None:
    tilts = replace(GIMBAL, limits=GimbalLimits(has_yaw=False))
    request = settled(target(40.0, -20.0), tilts)
    assert request.yaw_rate_rps == 0.0
    assert request.pitch_rate_rps < 0.0


def test_while_coasting_rates_fade() -> None:
    pointing = Pointing(CONFIG)
    for n in range(40):
        request = pointing.follow(target(40.0), GIMBAL, VEHICLE, 9.0 + n * 0.05, 0.0)
    assert request.yaw_rate_rps == 0.0


def at_angle(angle_deg: float, stop_deg: float = 150.0) -> GimbalState:
    stop_rad = math.radians(stop_deg)
    limits = GimbalLimits(yaw_min_rad=-stop_rad, yaw_max_rad=stop_rad)
    return replace(GIMBAL, relative_yaw_rad=math.radians(angle_deg), limits=limits)


@pytest.mark.parametrize("link_s", [0.0, 0.06, 0.2])
def test_what_is_under_way_counts_as_done(link_s: float) -> None:
    """The attitude is old, but the commands since have turned the gimbal all the way: no more is asked for."""
    pointing, farthest_rad = Pointing(CONFIG), 0.0
    seen = replace(GIMBAL, ours=True)
    history: list[tuple[float, float]] = []
    for n in range(40):  # a gimbal as configured, behind a link of link_s each way
        now_s = 20.0 + n * 0.05
        sent_s = now_s - link_s
        at_rad, at_rps = answer([(t_s + link_s, rate) for t_s, rate in history], sent_s, CONFIG.lag_s)
        seen = replace(seen, t_s=sent_s, rate_t_s=sent_s, yaw_rad=at_rad, relative_yaw_rad=at_rad, yaw_rate_rps=at_rps)
        aim = replace(target(40.0), t_s=now_s + link_s + 0.025)
        history.append((now_s, pointing.follow(aim, seen, VEHICLE, now_s).yaw_rate_rps))
        farthest_rad = max(farthest_rad, at_rad)
    assert at_rad == pytest.approx(math.radians(40), abs=0.01)
    assert farthest_rad < math.radians(44)


def answer(commands: list[tuple[float, float]], at_s: float, lag_s: float) -> tuple[float, float]:
    """Angle and rate at at_s in steps of a millisecond, from rest at 19.5 s."""
    angle_rad = rate_rps = 0.0
    for step in range(round((at_s - 19.5) * 1000)):
        t_s = 19.5 + step / 1000
        wanted = next((rate for act_s, rate in reversed(commands) if act_s <= t_s), 0.0)
        rate_rps += (wanted - rate_rps) * 0.001 / lag_s
        angle_rad += rate_rps * 0.001
    return angle_rad, rate_rps


def test_the_nose_turns_to_where_the_gimbal_looks() -> None:
    assert hand_over_rps(target(), at_angle(4.0), CONFIG) == 0.0  # dead band
    right = hand_over_rps(target(), at_angle(30.0), CONFIG)
    assert right == pytest.approx(CONFIG.hand_over_gain_ps * math.radians(25))
    assert hand_over_rps(target(), at_angle(-30.0), CONFIG) == pytest.approx(-right)
    assert hand_over_rps(target(), at_angle(170.0, 180.0), CONFIG) == CONFIG.max_hand_over_rps


@pytest.mark.parametrize("side", [1, -1])
def test_near_the_stop_the_nose_keeps_pace_with_the_target(side: int) -> None:
    moving = target(azimuth_rate_rps=0.3 * side)
    near = at_angle(38.0 * side, 40.0)
    assert side * (hand_over_rps(moving, near, CONFIG) - hand_over_rps(target(), near, CONFIG)) > 0.25
    inside = at_angle(15.0 * side, 40.0)
    assert hand_over_rps(moving, inside, CONFIG) == hand_over_rps(target(), inside, CONFIG)
    leaving = target(azimuth_rate_rps=-0.3 * side)  # what comes back by itself needs no help
    assert hand_over_rps(leaving, near, CONFIG) == hand_over_rps(target(), near, CONFIG)


def test_one_that_turns_on_and_on_has_no_stop() -> None:
    endless = replace(at_angle(120.0), limits=GimbalLimits(yaw_min_rad=-math.inf, yaw_max_rad=math.inf))
    rate = hand_over_rps(target(azimuth_rate_rps=0.3), endless, replace(CONFIG, hand_over_gain_ps=0.05))
    assert rate == pytest.approx(0.05 * math.radians(115))
    assert settled(target(40.0), endless).yaw_rate_rps > 0.0

"""The mock's own follow modes, and the judge of what is published for them."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.monitor import MonitorLimits, Rule, Truth, WireMonitor
from sitl_mocks.vehicle import MockVehicle, Mode, Personality

READY = {
    Personality.PX4: {"FLW_TGT_DST": 12.0},
    Personality.ARDUPILOT: {"FOLL_ENABLE": 1, "FOLL_SYSID": 255, "FOLL_OFS_X": -12, "FOLL_OFS_Z": -8},
}
both = pytest.mark.parametrize("personality", list(Personality))


def target(north_m=20.0, speed_mps=0.0, *, sender=255, height_m=0.0, capabilities=3, velocity=None):
    """A FOLLOW_TARGET as a datagram, and the message itself."""
    message = mavlink.MAVLink_follow_target_message(
        0, capabilities, round((47.397742 + math.degrees(north_m / 6378137.0)) * 1e7), round(8.545594e7),
        488.0 + height_m, velocity or [speed_mps, 0.0, 0.0], [0.0] * 3, [1.0, 0.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3, 0,
    )  # fmt: skip
    return bytes(message.pack(mavlink.MAVLink(None, sender, 191)))


def hovering(personality, **parameters):
    vehicle = MockVehicle(personality, airborne_m=9.0, parameters={**READY[personality], **parameters}, tick_s=0.01)
    vehicle.step(0.0)
    return vehicle


def enter(vehicle, now_s=0.01):
    mode = (1.0, 4.0, 8.0) if vehicle.personality is Personality.PX4 else (1.0, 23.0, 0.0)
    order = mavlink.MAVLink_command_long_message(1, 1, 176, 0, *mode, 0, 0, 0, 0)
    vehicle.receive(bytes(order.pack(mavlink.MAVLink(None, 255, 191))), now_s)


def follow(vehicle, from_s, to_s, place=lambda t_s: (20.0, 0.0), **how):
    """Published ten times a second."""
    for k in range(round(from_s * 10), round(to_s * 10)):
        vehicle.receive(target(*place(k / 10), **how), k / 10)
        vehicle.step(k / 10 + 0.09)


def north_m(vehicle):
    return vehicle.pose().position_ned_m[0]


@both
def test_it_keeps_its_distance_and_height_and_faces_the_target(personality):
    vehicle = hovering(personality)
    enter(vehicle)
    assert vehicle.autopilot.mode is Mode.FOLLOW
    follow(vehicle, 0.1, 12.0)
    pose = vehicle.pose()
    assert math.dist(pose.position_ned_m, (8.0, 0.0, -8.0)) < 0.6
    assert abs(pose.yaw_rad) < 0.05
    assert vehicle.message(0, 12.0).custom_mode == (23 if personality is Personality.ARDUPILOT else 4 << 16 | 8 << 24)


@both
def test_it_goes_along_and_stops_three_seconds_after_the_last_one(personality):
    vehicle = hovering(personality)
    enter(vehicle)
    follow(vehicle, 0.1, 10.0, lambda t_s: (20.0 + 3.0 * t_s, 3.0))
    there_m = north_m(vehicle)
    assert there_m == pytest.approx(20.0 + 29.7 - 12.0, abs=2.0)
    for k in range(1000, 1800):
        vehicle.step(k / 100)
    assert 6.0 < north_m(vehicle) - there_m < 14.0
    assert math.hypot(*vehicle.pose().velocity_ned_mps) < 0.3
    assert vehicle.autopilot.mode is Mode.FOLLOW  # and says nothing of it


@both
def test_without_a_target_it_holds(personality):
    vehicle = hovering(personality)
    enter(vehicle)
    for k in range(1, 500):
        vehicle.step(k / 100)
    assert math.dist(vehicle.pose().position_ned_m, (0.0, 0.0, -9.0)) < 0.2


@pytest.mark.parametrize(
    ("parameters", "how"),
    [({}, {"sender": 250}), ({"FOLL_OFS_TYPE": 1}, {}), ({"FOLL_DIST_MAX": 10}, {}), ({}, {"capabilities": 2})],
)
def test_arducopter_listens_to_its_target_only(parameters, how):
    vehicle = hovering(Personality.ARDUPILOT, **parameters)
    enter(vehicle)
    follow(vehicle, 0.1, 4.0, **how)
    assert abs(north_m(vehicle)) < 0.2


def test_arducopter_without_the_mode_says_so():
    vehicle = hovering(Personality.ARDUPILOT, FOLL_ENABLE=0)
    enter(vehicle)
    assert vehicle.autopilot.mode is Mode.BRAKE


def test_arducopter_keeps_the_place_it_has_where_no_offset_is_set():
    vehicle = hovering(Personality.ARDUPILOT, FOLL_OFS_X=0, FOLL_OFS_Z=0)
    enter(vehicle)
    follow(vehicle, 0.1, 8.0, lambda t_s: (20.0 + 2.0 * t_s, 2.0))
    assert north_m(vehicle) == pytest.approx(2.0 * 7.99, abs=1.5)
    assert vehicle.pose().position_ned_m[2] == pytest.approx(-9.0, abs=0.3)


IN, OUT = (Truth(external, True, True, (0.0, 0.0, -9.0), 0.0, external) for external in (True, False))


def judged(*steps, **limits):
    """Feed (time, datagram, truth); the rules broken."""
    monitor = WireMonitor(MonitorLimits(**limits))
    monitor.operator_confirms(0.0)
    for t_s, datagram, truth in steps:
        monitor.feed(t_s, datagram, truth)
    return [reason.rule for reason in monitor.reasons]


def test_the_judge_takes_a_sound_target_in_its_mode():
    steps = [(0.1 * k, target(20 + 0.3 * k, 3.0), IN) for k in range(20)]
    assert judged(*steps, confirmation_needed=True) == []


@pytest.mark.parametrize(
    ("steps", "rule"),
    [
        ([(0.1, target(20.0), OUT)], Rule.NOT_EXTERNAL),
        ([(0.1, target(20.0), IN), (0.2, target(24.0), IN)], Rule.SLEW),
        ([(0.1, target(20.0, 13.0), IN)], Rule.OVER_LIMIT),
        ([(0.1, target(20.0, math.nan), IN)], Rule.OVER_LIMIT),
        ([(0.1, target(20.0, capabilities=2), IN)], Rule.OVER_LIMIT),
        ([(0.1, target(20.0), IN), (1.0, target(20.0), OUT), (3.0, target(20.0), OUT)], Rule.NOT_EXTERNAL),
    ],
)
def test_the_judge_counts_what_is_not(steps, rule):
    assert judged(*steps) == [rule]


def test_the_judge_wants_a_confirmation():
    monitor = WireMonitor(MonitorLimits(confirmation_needed=True))
    monitor.feed(0.1, target(20.0, 2.0), IN)
    assert [reason.rule for reason in monitor.reasons] == [Rule.UNCONFIRMED]


def test_the_judge_counts_a_target_after_its_bound():
    monitor = WireMonitor(MonitorLimits())
    monitor.still_by_s, monitor.silent_by_s = 1.0, 2.0
    for t_s, speed_mps in ((0.9, 2.0), (1.5, 0.0), (1.6, 2.0), (2.5, 0.0)):
        monitor.feed(t_s, target(20.0, speed_mps), IN)
    assert [reason.rule for reason in monitor.reasons] == [Rule.TOO_LATE] * 2

"""The yaw law: signs, what it knows of its own vehicle, and vehicles that answer otherwise than it thinks."""

import itertools
import math
from collections import deque
from dataclasses import replace

import pytest

from control.config import ShapingConfig
from control.yaw import YawState, own_heading, turned, yaw_rate_rps

from .follow_rig import CAMERA, CONFIG, VEHICLE, target

MOST_RPS2 = ShapingConfig().yaw_acceleration_rps2
SLOPE_RPS2 = ShapingConfig().yaw_slope_rps2
ACTS_S = 10.0 + CONFIG.yaw_delay_s


def ask(seen, vehicle=VEHICLE, camera=CAMERA, config=CONFIG, state=None, last=(9.0, 0.0), now_s=10.0):
    return yaw_rate_rps(seen, vehicle, camera, now_s, state, last, config, MOST_RPS2)


@pytest.mark.parametrize(("azimuth", "yaw", "sign"), [(0.3, 0.0, 1), (-0.3, 0.0, -1), (-3.0, 3.0, 1), (3.0, -3.0, -1)])
def test_yaw_turns_the_short_way_towards_the_target(azimuth, yaw, sign):
    rate, _ = ask(target(azimuth_rad=azimuth), replace(VEHICLE, yaw_rad=yaw))
    assert math.copysign(1, rate) == sign
    assert abs(rate) <= CONFIG.max_yaw_rate_rps
    assert ask(target(azimuth_rad=yaw), replace(VEHICLE, yaw_rad=yaw))[0] == 0.0


def test_yaw_feeds_the_bearing_rate_forward_as_far_as_it_is_known():
    """A vehicle that turns along with the target, told to: it is told so again."""

    def rate(std):
        azimuth = 0.2 * CONFIG.yaw_delay_s
        seen = target(t_s=ACTS_S, azimuth_rad=azimuth, azimuth_rate_rps=0.2, azimuth_rate_std_rps=std)
        return ask(seen, replace(VEHICLE, yaw_rate_rps=0.2), last=(9.0, 0.2))[0]

    assert rate(0.0) == pytest.approx(0.2)
    assert rate(100.0) < 0.1


def test_the_target_is_carried_on_to_when_the_command_acts():
    late, early = target(t_s=ACTS_S, azimuth_rad=0.1, azimuth_rate_rps=0.3), target(t_s=9.5, azimuth_rate_rps=0.3)
    early = replace(early, azimuth_rad=0.1 - 0.3 * (ACTS_S - 9.5))
    assert ask(early)[0] == pytest.approx(ask(late)[0])


def test_the_mount_is_taken_into_account():
    aside = replace(CAMERA, mount_rpy_rad=(0.0, 0.0, 0.4))
    assert ask(target(azimuth_rad=0.4), camera=aside)[0] == pytest.approx(0.0)


def test_an_error_no_larger_than_noise_is_answered_softly():
    """A tenth of the error asks for much less than a tenth."""
    small, large = (ask(target(azimuth_rad=math.radians(error)))[0] for error in (0.5, 5.0))
    assert 0.0 < small < large / 30


@pytest.mark.parametrize("dt_s", [0.0, 0.01, 0.3])
def test_turning_in_steps_is_turning_at_once(dt_s):
    at_once = turned((0.3, 0.5), -0.8, 2 * dt_s, 0.45)
    assert turned(turned((0.3, 0.5), -0.8, dt_s, 0.45), -0.8, dt_s, 0.45) == pytest.approx(at_once)
    assert turned((0.3, 0.5), 0.5, dt_s, 0.45) == pytest.approx((0.3 + 0.5 * dt_s, 0.5))


def test_own_motion_is_what_was_told_and_has_begun_to_act():
    sent = ((9.90, 1.0), (9.95, -0.5), (10.0, 0.7))
    heading, rate = 0.2, 0.1
    vehicle = replace(VEHICLE, yaw_rad=heading, yaw_rate_rps=rate)
    for n in range(12_000):  # of 10 µs
        t = 10.0 + n * 1e-5
        acting = [u for sent_s, u in sent if sent_s + CONFIG.yaw_delay_s <= t]
        rate += (acting[-1] - rate) * 1e-5 / CONFIG.yaw_lag_s
        heading += rate * 1e-5
    assert own_heading(vehicle, sent, 10.12, CONFIG) == pytest.approx((heading, rate), abs=1e-4)
    assert own_heading(vehicle, sent[2:], 10.05, CONFIG) == pytest.approx((0.2 + 0.1 * 0.05, 0.1))
    assert own_heading(replace(vehicle, attitude_t_s=None), sent, 10.12, CONFIG) == (0.2, 0.1)


def test_the_plan_goes_on_from_what_was_really_sent():
    """What the gate took away, or coasting, the vehicle has not done either."""
    asked, state = ask(target(azimuth_rad=1.0))
    obeyed = ask(target(azimuth_rad=1.0), state=state, last=(10.0, asked), now_s=10.05)[1]
    stopped = ask(target(azimuth_rad=1.0), state=state, last=(10.0, 0.0), now_s=10.05)[1]
    assert (obeyed.heading_rad, obeyed.rate_rps) == pytest.approx(turned((0.0, 0.0), asked, 0.05, CONFIG.yaw_lag_s))
    assert (stopped.heading_rad, stopped.rate_rps) == (0.0, 0.0)


def test_after_a_gap_the_plan_begins_where_the_vehicle_is():
    elsewhere = YawState(5.0, 10.0, 2.0, 1.0, 0.3, 0.2, ((9.9, 1.0),))
    later = replace(VEHICLE, yaw_rad=0.4, attitude_t_s=11.0)
    after = ask(target(t_s=11.0, azimuth_rad=0.4), later, state=elsewhere, now_s=11.0)[1]
    assert (after.heading_rad, after.rate_rps, after.correction_rps, after.steady_rps2) == (0.4, 0.0, 0.0, 0.0)
    assert after.sent == ((9.0, 0.0),)


def test_a_follow_begins_gently():
    far = target(azimuth_rad=1.0)
    begun = YawState(10.0, 11.0, 0.0, 0.0)
    later = replace(VEHICLE, attitude_t_s=11.0)
    gentle, _ = ask(far, later, state=begun, last=(11.0, 0.0), now_s=11.05)
    quick, _ = ask(far, later, state=replace(begun, began_s=9.0), last=(11.0, 0.0), now_s=11.05)
    assert 0 < gentle <= math.radians(30) < quick
    assert ask(far)[0] == gentle


class Airframe:
    """Dead time, then a yaw rate that follows in second order: gain (1/s) and that of the acceleration."""

    def __init__(self, dead_s, gain_ps, acceleration_gain_ps=200.0, most_rps2=6.0, most_rps=3.5):
        self.line = deque([0.0] * round(dead_s / 0.01))
        self.gains, self.most_rps2, self.most_rps = (gain_ps, acceleration_gain_ps), most_rps2, most_rps
        self.yaw_rad = self.rate_rps = self.turn_rps2 = 0.0

    def step(self, command_rps):
        self.line.append(min(max(command_rps, -self.most_rps), self.most_rps))
        wanted = self.gains[0] * (self.line.popleft() - self.rate_rps)
        wanted = min(max(wanted, -self.most_rps2), self.most_rps2)
        for _ in range(4):
            self.turn_rps2 += min(self.gains[1] * 0.0025, 1.0) * (wanted - self.turn_rps2)
        self.rate_rps += self.turn_rps2 * 0.01
        self.yaw_rad += self.rate_rps * 0.01


def turn_to(azimuth, airframe, seconds=8.0, age_s=0.03, attitude_s=0.02):
    """Heading errors every 10 ms while the law turns the airframe to a standing target."""
    state, last, command, errors = YawState(-9.0, 0.0, 0.0, 0.0), (0.0, 0.0), 0.0, []
    vehicle, waiting = replace(VEHICLE, attitude_t_s=0.0), deque()
    for n in range(round(seconds / 0.01)):
        now = n * 0.01
        if n % round(attitude_s / 0.01) == 0:
            yaw = math.remainder(airframe.yaw_rad, 2 * math.pi)
            waiting.append(replace(VEHICLE, attitude_t_s=now, yaw_rad=yaw, yaw_rate_rps=airframe.rate_rps))
        while waiting and waiting[0].attitude_t_s + age_s <= now + 1e-9:
            vehicle = waiting.popleft()
        if n % 5 == 0:
            seen = target(t_s=now, azimuth_rad=azimuth)
            wish, state = ask(seen, vehicle, state=state, last=last, now_s=now)
            step = SLOPE_RPS2 * 0.05
            command += min(max(wish - command, -step), step)
            last = now, command
        airframe.step(command)
        errors.append(azimuth - airframe.yaw_rad)
    return errors


LAGS = {f"{lag:g} s": lambda lag=lag: Airframe(0.05, 1 / lag) for lag in (0.15, 0.25, 0.35, 0.6)}
AIRFRAMES = {"PX4": lambda: Airframe(0.05, 2.2, 40.0), **LAGS}


def is_settled(errors, azimuth, overshoot_frac):
    """Not far past it, not to and fro, and there in the end."""
    calm = max(abs(e) for e in errors[-150:]) < math.radians(0.5)
    return calm and min(errors) > -overshoot_frac * azimuth - math.radians(0.4) and swings(errors) <= 3


@pytest.mark.parametrize("attitude_s", [0.02, 0.1])
@pytest.mark.parametrize("name", AIRFRAMES)
@pytest.mark.parametrize(("degrees", "overshoot_frac"), [(2, 0.25), (20, 0.4), (90, 0.1)])
def test_every_airframe_is_turned_to_the_target_without_ringing(name, degrees, overshoot_frac, attitude_s):
    azimuth = math.radians(degrees)
    assert is_settled(turn_to(azimuth, AIRFRAMES[name](), attitude_s=attitude_s), azimuth, overshoot_frac)


def test_ringing_would_be_noticed():
    """A command ten times as late as told."""
    azimuth = math.radians(20)
    assert not is_settled(turn_to(azimuth, Airframe(0.7, 10.0)), azimuth, 0.4)


def swings(errors):
    """How often the error goes from one side to the other, leaving a band of half a degree."""
    sides = [math.copysign(1, e) for e in errors if abs(e) > math.radians(0.5)]
    return sum(a != b for a, b in itertools.pairwise(sides))

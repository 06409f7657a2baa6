"""A camera that does not turn with the vehicle is found in flight, and a right one is never accused."""

import math
import random

import pytest

from control.camera_check import CameraCheck, Verdict
from control.modes import FollowMode
from control.types import BearingMeasurement

from .closed_loop import Setup, fly, runner, sine, standing, zigzag, zigzag_away

MIRRORED = ("mirrored", "upside down")
CROSSING = (sine, zigzag, zigzag_away)


def aside(t):
    """Standing 6 degrees to the right of the nose."""
    return 15.0, 1.5


@pytest.mark.parametrize("camera", MIRRORED)
@pytest.mark.parametrize("path", [*CROSSING, aside, runner])
@pytest.mark.parametrize("delay_s", [0.1, 0.25])
def test_a_mirrored_camera_is_found_within_a_second_and_a_half_of_engaging(camera, path, delay_s):
    for seed in range(3):
        result = fly(path, Setup(camera=camera, duration_s=4.0, settle_s=1.0, delay_s=delay_s, seed=seed))
        assert result.verdict is Verdict.WRONG
        assert result.verdict_s <= 1.5


@pytest.mark.parametrize("path", CROSSING)
@pytest.mark.parametrize("delay_s", [0.1, 0.25])
def test_a_camera_on_a_gimbal_nobody_told_of_is_found_within_five_seconds(path, delay_s):
    for seed in range(3):
        setup = Setup(camera="on a gimbal", duration_s=7.0, settle_s=1.0, delay_s=delay_s, seed=seed)
        result = fly(path, setup)
        assert result.verdict is Verdict.WRONG
        assert result.verdict_s <= 5.0


@pytest.mark.parametrize("path", [*CROSSING, standing, aside, runner])
@pytest.mark.parametrize("mode", [FollowMode.FOLLOW, FollowMode.SPOTLIGHT])
def test_a_right_camera_is_never_accused(path, mode):
    """Noise of 1 to 4 px, 10 to 30 pictures a second, 0.05 to 0.35 s late: not even halfway to a verdict."""
    rng = random.Random(7)
    for seed in range(6):
        setup = Setup(
            mode=mode, duration_s=15.0, settle_s=8.0, seed=seed, fps=rng.choice([10.0, 20.0, 30.0]),
            delay_s=rng.uniform(0.05, 0.35), noise_px=rng.uniform(1.0, 4.0), hidden=(6.0, 6.4),
        )  # fmt: skip
        result = fly(path, setup)
        assert result.verdict is not Verdict.WRONG
        assert result.largest_odds < 7.0, setup
    assert path not in CROSSING or result.verdict is Verdict.RIGHT


@pytest.mark.parametrize("delay_error_s", [0.06, -0.06])
@pytest.mark.parametrize("path", CROSSING)
def test_a_latency_wrong_by_60_ms_is_no_wrong_camera(path, delay_error_s):
    for seed in range(2):
        setup = Setup(mode=FollowMode.SPOTLIGHT, duration_s=9.0, settle_s=4.0, seed=seed, delay_error_s=delay_error_s)
        result = fly(path, setup)
        assert result.verdict is Verdict.RIGHT
        assert result.largest_odds < 5.0


def series(gain, yaw_of, seconds=4.0, noise_rad=0.004, seed=1, tilt=lambda t: 0.0):
    """(bearing, yaw) of a standing target, seen by a camera whose picture moves by gain for each radian of yaw."""
    rng = random.Random(seed)
    for step in range(round(seconds * 20)):
        t, yaw = step / 20, yaw_of(step / 20)
        offset = 0.05 + gain * yaw + rng.gauss(0, noise_rad)
        yield BearingMeasurement(t, yaw + offset, -0.3 + tilt(t) + rng.gauss(0, noise_rad), -3.0, 0.9), yaw


def judge(pictures):
    check = CameraCheck()
    for bearing, yaw in pictures:
        check.saw(bearing, yaw)
    return check.verdict


def swing(t):
    """Yaw in the hands of a pilot, through north and back."""
    return 0.5 * math.sin(2.0 * t)


@pytest.mark.parametrize(("gain", "verdict"), [(-1.0, Verdict.RIGHT), (1.0, Verdict.WRONG), (0.0, Verdict.WRONG)])
def test_it_judges_by_the_vehicles_turning_alone(gain, verdict):
    assert judge(series(gain, swing)) is verdict
    assert judge(series(gain, lambda t: 0.04 * math.sin(2.0 * t))) is Verdict.OPEN  # 2 degrees are too few


def test_a_camera_on_its_side_is_found():
    for side in (1.0, -1.0):
        assert judge(series(0.0, swing, tilt=lambda t, side=side: side * swing(t))) is Verdict.WRONG


def test_turning_through_south_is_no_jump():
    def round_and_round(t):
        return math.remainder(3.0 + 0.6 * t * t, 2 * math.pi)

    wrapped = [
        (BearingMeasurement(b.t_capture_s, b.azimuth_rad, b.elevation_rad, b.log_size, 0.9), y)
        for b, y in series(0.0, round_and_round, seconds=1.5)
    ]
    right = [(BearingMeasurement(b.t_capture_s, 3.0, b.elevation_rad, b.log_size, 0.9), y) for b, y in wrapped]
    assert judge(right) is Verdict.RIGHT


def test_what_shakes_all_alike_tells_nothing():
    """A jumping box and a nodding picture, while the vehicle turns little: neither way."""
    rng = random.Random(3)
    shaken = [
        (BearingMeasurement(b.t_capture_s, b.azimuth_rad + rng.gauss(0, 0.1), b.elevation_rad, -3.0, 0.9), y)
        for b, y in series(-1.0, lambda t: 0.06 * math.sin(2 * t), tilt=lambda t: 0.1 * math.sin(1.5 * t))
    ]
    assert judge(shaken) is Verdict.OPEN


def test_a_pause_begins_the_filters_anew_and_old_pictures_are_ignored():
    check = CameraCheck()
    pictures = list(series(-1.0, swing))
    for bearing, yaw in pictures[:10]:
        check.saw(bearing, yaw)
    odds = check.odds
    check.saw(*pictures[5])  # an old one
    assert check.odds == odds
    check.saw(*pictures[30])  # a second later
    assert check.odds == odds
    check.reset()
    assert check.odds == 0.0
    assert check.verdict is Verdict.OPEN


def test_a_verdict_stays_until_reset():
    check = CameraCheck()
    for bearing, yaw in series(1.0, swing):
        check.saw(bearing, yaw)
    assert check.verdict is Verdict.WRONG
    for bearing, yaw in series(-1.0, swing):
        check.saw(BearingMeasurement(bearing.t_capture_s + 10, bearing.azimuth_rad, -0.3, -3.0, 0.9), yaw)
    assert check.verdict is Verdict.WRONG

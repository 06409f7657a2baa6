"""The target filter against a filter written out in numpy, and what it does with bad, late and odd input."""

import itertools
import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from control.config import EstimatorConfig
from control.estimator import TargetEstimator, fading_transition, process_noise, transition
from tests.control.bearings import noisy_track, sample, settled, wild_track
from tests.control.reference_filter import run

CONFIG = EstimatorConfig()


@pytest.mark.parametrize("ahead_s", [0.0, 0.13, 1.7])
@pytest.mark.parametrize("seed", range(20))
def test_equal_to_the_textbook_filter_whatever_comes_late(seed, ahead_s):
    track, arriving = wild_track(seed)
    assert arriving != track
    estimator = TargetEstimator(EstimatorConfig(history_s=1.5))
    for m in arriving:
        estimator.update(m)
    end = track[-1].t_capture_s + ahead_s
    state, right = estimator.predict(end), run(track, end, CONFIG)
    azimuth, elevation, size = right.channels
    got = (
        state.elevation_rad, state.elevation_rate_rps, state.log_size, state.log_size_rate_ps, state.azimuth_rate_rps,
        state.azimuth_std_rad, state.azimuth_rate_std_rps, state.elevation_std_rad,
        state.log_size_std, state.log_size_rate_std_ps,
    )  # fmt: skip
    std = [math.sqrt(v) for v in (azimuth.p[0, 0], azimuth.p[1, 1], elevation.p[0, 0], size.p[0, 0], size.p[1, 1])]
    assert got == pytest.approx((*elevation.x, *size.x, azimuth.x[1], *std), rel=1e-9, abs=1e-9)
    assert math.remainder(state.azimuth_rad - azimuth.x[0], 2 * math.pi) == pytest.approx(0, abs=1e-9)
    assert not all(right.accepted)


def test_the_wild_tracks_show_every_branch():
    runs = [run(*(track, track[-1].t_capture_s), CONFIG) for track in (wild_track(seed)[0] for seed in range(20))]
    assert {0.0, 1.0} <= {r.level for r in runs}
    assert sum(not a for r in runs for a in r.accepted) > 20


def test_finds_the_rate_of_a_target_that_circles_through_south():
    estimator = TargetEstimator()
    for n in range(300):
        t = n * 0.05
        azimuth = math.remainder(0.8 * t, 2 * math.pi)
        assert estimator.update(sample(t, azimuth)), f"refused at {t} s, azimuth {azimuth}"
    state = estimator.predict(15.0)
    assert state.azimuth_rate_rps == pytest.approx(0.8, abs=1e-3)
    assert state.azimuth_rad == pytest.approx(math.remainder(0.8 * 15.0, 2 * math.pi), abs=1e-3)


def test_every_order_of_arrival_gives_the_same_state():
    track = noisy_track(count=5)
    reference = None
    for order in itertools.permutations(track[1:]):
        estimator = TargetEstimator(EstimatorConfig(history_s=5.0))
        for m in (track[0], *order):
            estimator.update(m)
        state = estimator.predict(1.0)
        reference = reference or state
        assert state == reference


def test_a_late_measurement_is_fused_at_its_own_time():
    in_time, late, without = TargetEstimator(), TargetEstimator(), TargetEstimator()
    track = noisy_track(count=40)
    held = track[33]
    for m in track:
        in_time.update(m)
        if m is not held:
            late.update(m)
            without.update(m)
    assert late.predict(5.0) == without.predict(5.0)
    assert late.update(held)
    assert late.predict(5.0) == in_time.predict(5.0)
    assert late.predict(5.0) != without.predict(5.0)


def test_a_measurement_older_than_the_history_or_known_already_is_refused():
    estimator = TargetEstimator(EstimatorConfig(history_s=0.5))
    for n in range(40):
        estimator.update(sample(n * 0.05))
    before = estimator.predict(3.0)
    assert not estimator.update(sample(0.51))
    assert not estimator.update(sample(-1.0))
    assert not estimator.update(sample(39 * 0.05))
    assert estimator.predict(3.0) == before
    assert estimator.update(sample(1.93))


def test_a_jump_is_rejected_counted_and_leaves_the_track_alone():
    estimator = TargetEstimator()
    for n in range(40):
        estimator.update(sample(n * 0.05))
    for n in range(5):
        assert not estimator.update(sample(2.0 + n * 0.05, azimuth=-1.5))
        assert estimator.rejections_in_a_row == n + 1
    state = estimator.predict(2.2)
    assert state.rejections_in_a_row == 5
    assert state.measured_t_s == pytest.approx(1.95)
    assert state.azimuth_rad == pytest.approx(0.5, abs=0.01)
    assert estimator.update(sample(2.25))
    assert estimator.rejections_in_a_row == 0


@pytest.mark.parametrize(
    ("offset", "accepted"), [({"azimuth": 0.5}, True), ({"elevation": 0.1}, False), ({"azimuth": 0.8}, False)]
)
def test_the_gate_looks_at_both_angles(offset, accepted):
    assert settled().update(replace_measurement(sample(2.0), offset)) is accepted


def test_a_size_that_cannot_be_leaves_the_bearing_to_count():
    estimator, fitting = settled(), settled()
    before = estimator.predict(2.0)
    assert estimator.update(sample(2.0, azimuth=0.51, log_size=-1.0))
    assert fitting.update(sample(2.0, azimuth=0.51))
    state = estimator.predict(2.0)
    assert state.azimuth_rad == fitting.predict(2.0).azimuth_rad > before.azimuth_rad
    assert (state.log_size, state.log_size_rate_ps) == pytest.approx((before.log_size, 0), abs=1e-9)
    assert state.log_size_std == pytest.approx(before.log_size_std)
    assert (state.rejections_in_a_row, state.measured_t_s) == (0, 2.0)


def test_a_size_that_stays_is_believed_in_the_end():
    estimator = settled()
    for n in range(CONFIG.size_rejections - 1):
        assert estimator.update(sample(2.0 + n * 0.05, log_size=-1.0))
    assert estimator.predict(2.0 + n * 0.05).log_size == pytest.approx(-2.5, abs=0.02)
    n += 1
    assert estimator.update(sample(2.0 + n * 0.05, log_size=-1.0))
    state = estimator.predict(2.0 + n * 0.05)
    assert (state.log_size, state.log_size_rate_ps) == pytest.approx((-1.0, 0.0))
    assert estimator.update(sample(2.05 + n * 0.05, log_size=-1.01))
    assert estimator.predict(2.05 + n * 0.05).log_size == pytest.approx(-1.005, abs=0.005)


def test_a_bearing_that_jumps_takes_its_size_with_it():
    estimator, untouched = settled(), settled()
    for n in range(40):
        assert not estimator.update(sample(2.0 + n * 0.001, azimuth=2.0, log_size=-2.45))
    got, expected = estimator.predict(2.1), untouched.predict(2.1)
    assert (got.azimuth_rad, got.log_size) == pytest.approx((expected.azimuth_rad, expected.log_size))
    assert got.rejections_in_a_row == 40


def test_the_rate_of_size_is_bounded():
    estimator = TargetEstimator()
    for n in range(40):
        estimator.update(sample(n * 0.05, log_size=-2.5 - 0.9 * n * 0.05))
    assert estimator.predict(1.95).log_size_rate_ps == -CONFIG.max_log_size_rate_ps


def test_unmeasured_the_rates_of_elevation_and_size_fade_and_that_of_azimuth_does_not():
    estimator = TargetEstimator()
    for n in range(80):
        t = n * 0.05
        estimator.update(sample(t, azimuth=0.3 * t, elevation=-0.2 - 0.1 * t, log_size=-2.5 + 0.2 * t))
    last = 79 * 0.05
    seen = estimator.predict(last)
    held, faded = estimator.predict(last + CONFIG.rate_hold_s), estimator.predict(last + CONFIG.rate_hold_s + 0.6)
    for rate in ("elevation_rate_rps", "log_size_rate_ps", "azimuth_rate_rps"):
        assert getattr(held, rate) == pytest.approx(getattr(seen, rate))
    assert faded.azimuth_rate_rps == pytest.approx(seen.azimuth_rate_rps)
    assert faded.log_size_rate_ps == pytest.approx(seen.log_size_rate_ps * math.exp(-0.6 / CONFIG.rate_fade_s))
    assert faded.elevation_rate_rps == pytest.approx(seen.elevation_rate_rps * math.exp(-0.6 / CONFIG.rate_fade_s))
    reach = CONFIG.rate_hold_s + CONFIG.rate_fade_s
    assert estimator.predict(last + 60).log_size == pytest.approx(seen.log_size + reach * seen.log_size_rate_ps)


@pytest.mark.parametrize("age_s", [0.0, 0.2, 1.0])
def test_fading_in_steps_is_fading_at_once(age_s):
    at_once = fading_transition(0.7, age_s, age_s + 0.1, CONFIG)
    steps = np.eye(6)
    for n in range(7):
        steps = fading_transition(0.1, age_s + 0.1 * n, age_s + 0.1 + 0.1 * n, CONFIG) @ steps
    assert steps == pytest.approx(at_once)


def replace_measurement(m, offset):
    names = {"azimuth": "azimuth_rad", "elevation": "elevation_rad", "log_size": "log_size"}
    return replace(m, **{names[k]: v for k, v in offset.items()})


@pytest.mark.parametrize(
    "field", ["t_capture_s", "azimuth_rad", "elevation_rad", "log_size", "confidence", "log_aspect"]
)
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_nan_and_inf_change_nothing(field, bad):
    estimator = TargetEstimator()
    assert not estimator.update(replace(sample(0.0), **{field: bad}))
    assert estimator.predict(1.0) is None
    for n in range(10):
        estimator.update(sample(n * 0.05))
    before = estimator.predict(1.0)
    assert not estimator.update(replace(sample(0.6), **{field: bad}))
    assert estimator.predict(1.0) == before


def test_a_weak_score_weighs_less_and_below_the_floor_nothing():
    pulls = []
    for confidence in (1.0, 0.5, 0.3):
        estimator = TargetEstimator()
        for n in range(40):
            estimator.update(sample(n * 0.05))
        assert estimator.update(sample(2.0, azimuth=0.51, confidence=confidence))
        pulls.append(estimator.predict(2.0).azimuth_rad - 0.5)
    assert pulls[0] > pulls[1] > pulls[2] > 0
    before = estimator.predict(3.0)
    assert not estimator.update(sample(2.1, azimuth=0.51, confidence=0.19))
    assert estimator.predict(3.0) == before


def test_prediction_leaves_the_filter_alone_and_grows_less_sure():
    estimator = TargetEstimator()
    assert estimator.predict(0.0) is None
    for m in noisy_track():
        estimator.update(m)
    end = noisy_track()[-1].t_capture_s
    near, far = estimator.predict(end + 0.1), estimator.predict(end + 1.0)
    assert far.azimuth_std_rad > near.azimuth_std_rad > 0
    assert far.azimuth_rad == pytest.approx(near.azimuth_rad + 0.9 * near.azimuth_rate_rps)
    assert estimator.predict(end + 0.1) == near
    assert estimator.predict(math.nan) is None
    assert estimator.predict(end - 0.5) is not None
    estimator.reset()
    assert estimator.predict(end) is None
    assert estimator.rejections_in_a_row == 0


def test_process_noise_composes():
    whole = process_noise(0.3, CONFIG)
    f = transition(0.2)
    assert f @ process_noise(0.1, CONFIG) @ f.T + process_noise(0.2, CONFIG) == pytest.approx(whole)
    assert np.all(np.linalg.eigvalsh(whole) >= -1e-12)


def test_covariance_stays_symmetric_and_positive():
    estimator = TargetEstimator()
    for m in noisy_track(count=400):
        estimator.update(m)
    p = estimator._steps[-1].p
    assert np.array_equal(p, p.T)
    assert np.all(np.linalg.eigvalsh(p) > 0)


def test_importing_control_does_not_import_filterpy():
    code = "import sys, control.estimator, control.follow; print('filterpy' in sys.modules, 'scipy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]

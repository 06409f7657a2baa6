"""What the target filter makes of a box that is covered from one side: its aspect tells."""

import math
from dataclasses import replace

import numpy as np
import pytest

from control.config import EstimatorConfig
from control.estimator import TargetEstimator, covered_std
from tests.control.bearings import sample, settled

CONFIG = EstimatorConfig()


def covered(t, part, **changes):
    """The lower part of a box 0.1 x 0.2 rad, at full confidence."""
    return sample(
        t, elevation=-0.2 - 0.1 * (1 - part), log_size=0.5 * math.log(0.02 * part), log_aspect=math.log(0.5 / part),
        **changes,
    )  # fmt: skip


def test_a_box_cut_from_above_is_taken_for_covered_not_for_far_and_low():
    """Half of it within a quarter of a second; told nothing of the aspect, the filter runs after it."""
    ends = []
    for told in (True, False):
        estimator = TargetEstimator()
        for n in range(60):
            m = covered(n * 0.05, min(1.0, max(0.5, 1 - (n - 40) * 0.1)))
            assert estimator.update(m if told else replace(m, log_aspect=0.0))
            if n == 46:
                ends.append(estimator.predict(n * 0.05))
    kept, fooled = ends
    whole = 0.5 * math.log(0.02)
    assert kept.log_size - whole > -0.1 > fooled.log_size - whole
    assert abs(kept.elevation_rad + 0.2) < 0.02 < abs(fooled.elevation_rad + 0.2)
    assert kept.size_trust < 0.1
    assert kept.elevation_trust < 0.1
    assert (fooled.size_trust, fooled.elevation_trust) == (1.0, 1.0)


def test_which_side_is_cut_tells_which_angle_is_wrong():
    narrow, flat = sample(0.0, log_aspect=-0.8), sample(0.0, log_aspect=0.8)
    azimuth, elevation, size = covered_std(narrow, 0.0, CONFIG)
    assert azimuth > 0.01
    assert elevation == 0.0
    lost = math.expm1(0.8 - CONFIG.log_aspect_tolerance)
    width = math.exp(-2.5 - 0.4)
    assert azimuth == pytest.approx(CONFIG.covered_factor * width * lost / 2 / math.cos(0.2))
    assert size == pytest.approx(CONFIG.covered_factor * (0.8 - CONFIG.log_aspect_tolerance) / 2)
    azimuth, elevation, _ = covered_std(flat, 0.0, CONFIG)
    assert azimuth == 0.0
    assert elevation > 0.01
    assert np.all(covered_std(sample(0.0, log_aspect=0.1), 0.0, CONFIG) == 0.0)


def test_a_target_that_turns_slowly_is_never_taken_for_covered():
    estimator = TargetEstimator()
    for n in range(120):
        estimator.update(sample(n * 0.05, log_aspect=0.2 * n * 0.05))
        assert estimator.predict(n * 0.05).size_trust == 1.0


def test_an_aspect_that_stays_is_the_targets_in_the_end():
    estimator = settled()
    trusts = []
    for n in range(80):
        estimator.update(sample(2.0 + n * 0.05, log_aspect=0.6))
        trusts.append(estimator.predict(2.0 + n * 0.05).size_trust)
    assert trusts[0] < 0.05
    assert trusts[-1] == 1.0

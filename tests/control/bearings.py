"""Measurements for the target filter."""

import math
import random

from control.estimator import TargetEstimator
from control.types import BearingMeasurement


def sample(t, azimuth=0.5, elevation=-0.2, log_size=-2.5, confidence=0.9, log_aspect=0.0):
    return BearingMeasurement(t, azimuth, elevation, log_size, confidence, log_aspect)


def settled(**offset):
    estimator = TargetEstimator()
    for n in range(40):
        estimator.update(sample(n * 0.05, **offset))
    return estimator


def noisy_track(count=80, seed=3, rate=0.3):
    rng = random.Random(seed)
    t, track = 0.0, []
    for _ in range(count):
        t += rng.uniform(0.02, 0.12)
        track.append(
            sample(t, 0.5 + rate * t + rng.gauss(0, 0.004), -0.2 + rng.gauss(0, 0.004), -2.5 + rng.gauss(0, 0.03),
                   rng.uniform(0.5, 1.0))
        )  # fmt: skip
    return track


def wild_track(seed, count=120):
    """Turns, jumps, weak scores, gaps, all round the compass: (measurements, the order in which they arrive)."""
    rng = random.Random(seed)
    t, azimuth, rate, track = 0.0, rng.uniform(-3, 3), 0.0, []
    for _ in range(count):
        dt = rng.choice((0.02, 0.05, 0.05, 0.05, 0.1, 0.4 if rng.random() < 0.1 else 0.05)) * rng.uniform(0.9, 1.1)
        t += dt
        rate = rng.uniform(-1.5, 1.5) if rng.random() < 0.05 else rate
        azimuth += rate * dt
        jump = rng.choice((0.5, -1.0)) if rng.random() < 0.05 else 0.0
        track.append(
            sample(t, math.remainder(azimuth + jump + rng.gauss(0, 0.005), 2 * math.pi), -0.2 + rng.gauss(0, 0.005),
                   -2.5 + rng.gauss(0, 0.04) + (0.6 if rng.random() < 0.05 else 0.0), rng.uniform(0.3, 1.0))
        )  # fmt: skip
    late = {m.t_capture_s: m.t_capture_s + (rng.uniform(0.0, 0.4) if rng.random() < 0.3 else 0.0) for m in track}
    return track, [track[0], *sorted(track[1:], key=lambda m: late[m.t_capture_s])]  # with the first it begins

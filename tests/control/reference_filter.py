"""The target filter as a textbook would have it, to judge the real one by: sort what came, run it once through.

Three channels of two states each, every one a 2 x 2 Kalman filter in plain numpy; no history, no rewinding.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from control.config import EstimatorConfig
from control.types import BearingMeasurement


@dataclass
class Channel:
    """Value and rate."""

    x: np.ndarray
    p: np.ndarray

    def grow(self, f, q, dt):
        self.x = f @ self.x
        self.p = f @ self.p @ f.T + q**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])

    def fuse(self, z, variance):
        gain = self.p[:, 0] / (self.p[0, 0] + variance)
        self.x = self.x + gain * (z - self.x[0])
        left = np.eye(2) - np.outer(gain, [1.0, 0.0])
        self.p = left @ self.p @ left.T + variance * np.outer(gain, gain)  # Joseph's form


@dataclass
class Reference:
    """What it came to at the end, and which measurements it took."""

    channels: list[Channel]
    accepted: list[bool] = field(default_factory=list)
    level: float = 0.0


def coast(dt, age, config):
    """Rates of elevation and size hold, then fade, once unmeasured: integrated by the book, not in closed steps."""
    held = min(max(config.rate_hold_s - age, 0.0), dt)
    reach, left = held, 1.0
    if dt > held:
        left = math.exp(-(dt - held) / config.rate_fade_s)
        reach += config.rate_fade_s * (1.0 - left)
    return np.array([[1.0, reach], [0.0, left]])


def run(measurements: list[BearingMeasurement], t_end_s: float, config: EstimatorConfig) -> Reference:
    """Boxes of a whole target only (log_aspect 0). Azimuth is left unwrapped."""
    track = sorted(measurements, key=lambda m: m.t_capture_s)
    first = track[0]
    std = np.array([config.bearing_std_rad, config.bearing_std_rad, config.log_size_std])
    rate = config.initial_bearing_rate_std_rps
    rates = (rate, rate, config.initial_log_size_rate_std_ps)
    z = (first.azimuth_rad, first.elevation_rad, first.log_size)
    channels = [
        Channel(np.array([value, 0.0]), np.diag([(s / first.confidence) ** 2, r**2]))
        for value, s, r in zip(z, std, rates, strict=True)
    ]
    reference = Reference(channels, [True])
    calm, turning = config.calm_acceleration_rps2, config.bearing_acceleration_rps2
    last, seen, sized, mean, variance = first.t_capture_s, first.t_capture_s, first.t_capture_s, 0.0, 1.0
    misfits = 0
    for m in [*track[1:], None]:
        t = t_end_s if m is None else m.t_capture_s
        dt = t - last
        straight = np.array([[1.0, dt], [0.0, 1.0]])
        f = (straight, coast(dt, last - seen, config), coast(dt, last - sized, config))
        last = t
        azimuth, elevation, size = channels
        elevation.grow(f[1], config.elevation_acceleration_rps2, dt)
        size.grow(f[2], config.log_size_acceleration_ps2, dt)
        azimuth.grow(f[0], 0.0, dt)
        if m is None:
            level = 1.0 if dt > 0.3 else reference.level
            azimuth.grow(np.eye(2), calm ** (1 - level) * turning**level, dt)
            return reference
        r = (std / m.confidence) ** 2
        off = [
            math.remainder(m.azimuth_rad - azimuth.x[0], 2 * math.pi),
            m.elevation_rad - elevation.x[0],
            m.log_size - size.x[0],
        ]
        widest = azimuth.p[0, 0] + max(turning, config.gate_acceleration_rps2) ** 2 * dt**3 / 3 + r[0]
        odd = off[0] ** 2 / widest + off[1] ** 2 / (elevation.p[0, 0] + r[1])
        reference.accepted.append(odd <= config.gate_chi2)
        if not reference.accepted[-1]:
            azimuth.grow(np.eye(2), turning, dt)
            continue
        # How far to one side, in standard deviations of an average of white noise: 1.6 is nothing, 2.6 a turn.
        spread = math.sqrt(variance)
        score = off[0] / math.sqrt(azimuth.p[0, 0] + calm**2 * dt**3 / 3 + r[0])
        score = max(-4 * spread, min(4 * spread, score))
        weight = 1 - math.exp(-dt / 0.25)
        mean += weight * (score - mean)
        distance = abs(mean) / (spread * math.sqrt(weight / (2 - weight)))
        reference.level = max(0.0, min(1.0, (distance - 1.6) / 1.0))
        variance = max(0.5, variance + min(dt / 2.0, 1.0) * (min(score**2, 6 * variance) - variance))
        level = 1.0 if dt > 0.3 else reference.level
        azimuth.grow(np.eye(2), calm ** (1 - level) * turning**level, dt)
        azimuth.fuse(azimuth.x[0] + off[0], r[0])
        elevation.fuse(m.elevation_rad, r[1])
        seen = t
        if off[2] ** 2 / (size.p[0, 0] + r[2]) <= config.size_gate_chi2:
            size.fuse(m.log_size, r[2])
            sized, misfits = t, 0
        else:
            misfits += 1
        if misfits == config.size_rejections:  # begins anew with this one
            size.x, size.p = np.array([m.log_size, 0.0]), np.diag([r[2], rates[2] ** 2])
            size.fuse(m.log_size, r[2])
            sized, misfits = t, 0
        size.x[1] = max(-config.max_log_size_rate_ps, min(config.max_log_size_rate_ps, size.x[1]))
    return reference

"""Where the target is: a Kalman filter on the line of sight and the logarithm of the apparent size.

State (azimuth, its rate, elevation, its rate, log size, its rate), constant rates, process noise from white
acceleration. What is no longer measured is not carried on for ever: the rates of elevation and size fade, and
the size's is bounded, for the last boxes of a target that goes behind something are the wrong ones. Bearing and
size have a gate each, so that a box half covered still tells where the target is.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import astuple, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from control.attitude import wrap_pi
from control.config import EstimatorConfig
from control.manoeuvre import Manoeuvre
from control.types import BearingMeasurement, TargetState

Array = NDArray[np.float64]

_OBSERVE: Array = np.eye(6)[::2]  # (3, 6): azimuth, elevation, log size
_MOST_TURN_S = 0.2  # unseen for longer, the target's aspect is taken to have changed by no more
_UNSEEN_S = 0.3  # over a longer gap than this the target may have turned, whatever it did before


_CALM = Manoeuvre()


@dataclass(frozen=True, slots=True)
class _Step:
    """The filter just after one measurement: what a late one rewinds to."""

    measurement: BearingMeasurement
    x: Array  # (6,)
    p: Array  # (6, 6)
    accepted: bool
    rejections: int
    confidence: float
    measured_t_s: float
    size_t_s: float  # of the newest size that was fused
    log_aspect: float  # of the whole target, following no faster than a target can turn
    size_rejections: int = 0
    trust: tuple[float, float] = (1.0, 1.0)  # in elevation and size, as far as nothing covers them
    manoeuvre: Manoeuvre = _CALM


def transition(dt_s: float) -> Array:
    """(6, 6) constant-rate transition over dt_s."""
    f = np.eye(6)
    f[0, 1] = f[2, 3] = f[4, 5] = dt_s
    return f


def fading_transition(dt_s: float, age_s: float, size_age_s: float, config: EstimatorConfig) -> Array:
    """(6, 6) transition over dt_s whose rates of elevation and size fade once unmeasured for rate_hold_s.

    age_s, size_age_s: how long bearing and size have been unmeasured when it begins. In steps or at once: the same.
    """
    f = transition(dt_s)
    for at, age in ((2, age_s), (4, size_age_s)):
        kept_s = min(max(config.rate_hold_s - age, 0.0), dt_s)
        factor = math.exp((kept_s - dt_s) / config.rate_fade_s)
        f[at, at + 1] = kept_s + config.rate_fade_s * (1 - factor)
        f[at + 1, at + 1] = factor
    return f


def bearing_acceleration_rps2(manoeuvre: float, config: EstimatorConfig) -> float:
    """The azimuth's white acceleration between calm (0) and manoeuvre (1), on a logarithmic scale."""
    calm, most = config.calm_acceleration_rps2, config.bearing_acceleration_rps2
    return float(most * min(calm / most, 1.0) ** (1.0 - manoeuvre))


def process_noise(dt_s: float, config: EstimatorConfig, manoeuvre: float = 1.0) -> Array:
    """(6, 6) covariance that white acceleration adds over dt_s (continuous white noise model)."""
    block = np.array([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]])
    q = np.zeros((6, 6))
    for at, acceleration in (
        (0, bearing_acceleration_rps2(manoeuvre, config)),
        (2, config.elevation_acceleration_rps2),
        (4, config.log_size_acceleration_ps2),
    ):
        q[at : at + 2, at : at + 2] = acceleration**2 * block
    return q


def measurement_noise(confidence: float, config: EstimatorConfig) -> Array:
    """(3, 3) covariance; standard deviations grow as 1 / confidence, a weak score slows rather than switches."""
    weak = 1.0 / min(max(confidence, config.confidence_floor), 1.0)
    std = np.array([config.bearing_std_rad, config.bearing_std_rad, config.log_size_std]) * weak
    return np.diag(std**2)


def covered_std(measurement: BearingMeasurement, log_aspect: float, config: EstimatorConfig) -> Array:
    """(3,) by how much a side that is newly hidden may mislead: azimuth (rad), elevation (rad), log size.

    log_aspect: that of the whole box. A box that lost of its width, or height, to one side has its centre off
    by half of what is lost, and its log size by half of the change of its log aspect.
    """
    change = measurement.log_aspect - log_aspect
    change = math.copysign(min(max(abs(change) - config.log_aspect_tolerance, 0.0), 2.0), change)
    width_rad = math.exp(measurement.log_size + measurement.log_aspect / 2)
    height_rad = math.exp(measurement.log_size - measurement.log_aspect / 2)
    across_rad = width_rad * math.expm1(max(-change, 0.0)) / 2 / max(math.cos(measurement.elevation_rad), 0.1)
    return config.covered_factor * np.array(
        [across_rad, height_rad * math.expm1(max(change, 0.0)) / 2, abs(change) / 2]
    )


class TargetEstimator:
    """The filter with its gate, unwrapping, and a short history into which late measurements are sorted."""

    def __init__(self, config: EstimatorConfig | None = None) -> None:
        # Here, because filterpy takes scipy with it: a second and more that `import control` must not cost.
        from filterpy.kalman import KalmanFilter

        self._config = config or EstimatorConfig()
        self._kalman: Any = KalmanFilter(dim_x=6, dim_z=3)
        self._kalman.H = _OBSERVE
        self._steps: list[_Step] = []

    def reset(self) -> None:
        """Forget the target."""
        self._steps.clear()

    @property
    def rejections_in_a_row(self) -> int:
        """Measurements refused by the gate since the last accepted one."""
        return self._steps[-1].rejections if self._steps else 0

    def update(self, measurement: BearingMeasurement) -> bool:
        """Fuse at its own capture time; whether it was accepted.

        Refused without counting as a rejection: not finite, confidence below the floor, a capture time
        already fused, or older than the history. Refused and counted: outside the innovation gate.
        """
        if not all(map(math.isfinite, astuple(measurement))):
            return False
        if measurement.confidence < self._config.confidence_floor:
            return False
        if not self._steps:
            self._steps.append(self._first(measurement))
            return True
        at = bisect_right(self._steps, measurement.t_capture_s, key=lambda s: s.measurement.t_capture_s)
        if at == 0 or self._steps[at - 1].measurement.t_capture_s == measurement.t_capture_s:
            return False
        later = [step.measurement for step in self._steps[at:]]
        del self._steps[at:]
        for each in (measurement, *later):
            self._steps.append(self._next(self._steps[-1], each))
        accepted = self._steps[at].accepted
        self._forget_old()
        return accepted

    def predict(self, t_s: float) -> TargetState | None:
        """The target at any moment since the history began, in the future too; the filter stays as it is.

        None before the first measurement.
        """
        at = bisect_right(self._steps, t_s, key=lambda s: s.measurement.t_capture_s) - 1
        if at < 0 or not math.isfinite(t_s):
            return None
        step = self._steps[at]
        dt_s = t_s - step.measurement.t_capture_s
        f = self._transition(step, dt_s)
        x = f @ step.x
        level = 1.0 if dt_s > _UNSEEN_S else step.manoeuvre.level
        std = np.sqrt(np.diag(f @ step.p @ f.T + process_noise(dt_s, self._config, level)))
        return TargetState(
            t_s=t_s,
            azimuth_rad=wrap_pi(float(x[0])),
            azimuth_rate_rps=float(x[1]),
            elevation_rad=float(x[2]),
            elevation_rate_rps=float(x[3]),
            log_size=float(x[4]),
            log_size_rate_ps=float(x[5]),
            azimuth_std_rad=float(std[0]),
            azimuth_rate_std_rps=float(std[1]),
            log_size_std=float(std[4]),
            confidence=step.confidence,
            measured_t_s=step.measured_t_s,
            rejections_in_a_row=step.rejections,
            elevation_std_rad=float(std[2]),
            log_size_rate_std_ps=float(std[5]),
            elevation_trust=step.trust[0],
            size_trust=step.trust[1],
            log_aspect=step.log_aspect,
        )

    def _first(self, m: BearingMeasurement) -> _Step:
        x = np.array([m.azimuth_rad, 0.0, m.elevation_rad, 0.0, m.log_size, 0.0])
        rates = self._config.initial_bearing_rate_std_rps, self._config.initial_log_size_rate_std_ps
        p = np.zeros((6, 6))
        p[::2, ::2] = measurement_noise(m.confidence, self._config)
        p[1, 1] = p[3, 3] = rates[0] ** 2
        p[5, 5] = rates[1] ** 2
        return _Step(m, x, p, True, 0, m.confidence, m.t_capture_s, m.t_capture_s, m.log_aspect)

    def _transition(self, step: _Step, dt_s: float) -> Array:
        t_s = step.measurement.t_capture_s
        return fading_transition(dt_s, t_s - step.measured_t_s, t_s - step.size_t_s, self._config)

    def _next(self, step: _Step, m: BearingMeasurement) -> _Step:
        kalman, config = self._kalman, self._config
        dt_s = m.t_capture_s - step.measurement.t_capture_s
        f = self._transition(step, dt_s)
        x, grown = f @ step.x, f @ step.p @ f.T
        z = np.array([x[0] + wrap_pi(m.azimuth_rad - x[0]), m.elevation_rad, m.log_size])
        r = measurement_noise(m.confidence, config)
        covered = np.diag(covered_std(m, step.log_aspect, config) ** 2)
        whole = np.diag(r) / np.diag(r + covered)
        trust = float(whole[1]), float(whole[2])
        r += covered
        innovation = z - x[::2]
        # The gate asks what a target may do at most, the filter what this one seems to be doing.
        most = _symmetric(grown + process_noise(dt_s, config))
        allowed = np.diag(most)[::2] + np.diag(r)
        allowed[0] += max(config.gate_acceleration_rps2**2 - config.bearing_acceleration_rps2**2, 0.0) * dt_s**3 / 3
        surprise = innovation**2 / allowed
        if not surprise[0] + surprise[1] <= config.gate_chi2:
            return replace(step, measurement=m, x=x, p=most, accepted=False, rejections=step.rejections + 1)
        calm = process_noise(dt_s, config, 0.0)
        calm_std = math.sqrt(grown[0, 0] + calm[0, 0] + r[0, 0])
        manoeuvre = step.manoeuvre.after(float(innovation[0]) / calm_std, dt_s)
        level = 1.0 if dt_s > _UNSEEN_S else manoeuvre.level
        kalman.x, kalman.P = step.x.copy(), step.p.copy()
        kalman.predict(F=f, Q=process_noise(dt_s, config, level))
        size_fits = bool(surprise[2] <= config.size_gate_chi2)
        size_rejections = 0 if size_fits else step.size_rejections + 1
        if size_rejections >= config.size_rejections:  # the bearing agrees all along: this is the size it has now
            kalman.x[4:], kalman.P[4:, 4:] = (m.log_size, 0.0), self._first(m).p[4:, 4:]
            size_fits, size_rejections = True, 0
        size_x, size_p = kalman.x[4:].copy(), kalman.P[4:, 4:].copy()
        kalman.update(z, R=r)
        if not size_fits:
            kalman.x[4:], kalman.P[4:, 4:] = size_x, size_p
        bound = config.max_log_size_rate_ps
        kalman.x[5] = min(max(kalman.x[5], -bound), bound)
        size_t_s = m.t_capture_s if size_fits else step.size_t_s
        turn = config.log_aspect_rate_ps * min(dt_s, _MOST_TURN_S)
        log_aspect = step.log_aspect + min(max(m.log_aspect - step.log_aspect, -turn), turn)
        p = _symmetric(kalman.P)
        return _Step(
            m, kalman.x, p, True, 0, m.confidence, m.t_capture_s,
            size_t_s, log_aspect, size_rejections, trust, manoeuvre,
        )  # fmt: skip

    def _forget_old(self) -> None:
        oldest_s = self._steps[-1].measurement.t_capture_s - self._config.history_s
        while len(self._steps) > 1 and self._steps[1].measurement.t_capture_s <= oldest_s:
            del self._steps[0]


def _symmetric(p: Array) -> Array:
    half: Array = (p + p.T) / 2
    return half

"""Whether the picture turns as the vehicle does: a camera mirrored, rolled or on a gimbal is found.

Each belief predicts where the target will be seen next when the vehicle turns: it moves against the turn (the
camera as configured), with it (mirrored, or upside down), not at all (held still by a gimbal), or up or down
(on its side). All filters are of one kind, so that the target's own movement surprises them alike; only the
vehicle's turning tells them apart. Wald's sequential probability ratio test says when that is enough, and it
holds while the vehicle's turning follows from what was seen, as it does here.

On a gimbal that is known it is the gimbal's turning that counts. As that keeps the target in the middle, a picture
that stands still says nothing there, and only a mirrored or inverted one is looked for. So it is where the vehicle
turns by its own follow mode, which knows where the target is.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import Enum
from typing import Final

from control.attitude import wrap_pi
from control.types import BearingMeasurement

# Of an angle in the picture, across and upwards: the box's jitter, the attitude's age (a vehicle nods more quickly
# than it turns), a box cut off below.
_ACROSS_STD_RAD: Final = 0.008
_UPWARD_STD_RAD: Final = 0.02
_LATENCY_STD_S: Final = 0.1  # the picture may be so much older or newer than believed, while the vehicle turns
_ACCELERATION_RPS2: Final = 0.1  # of the target as seen; its square times a second is the noise's density
_RATE_STD_RPS: Final = 0.3
_WORST_ERROR: Final = 16.0  # squared and by its variance; no single picture decides
_PICTURES: Final = 10.0  # over so many errors are averaged
_ENOUGH: Final = 12.0  # logarithm of the odds: one wrong verdict in a hundred thousand
_ENOUGH_TURN_RAD: Final = 0.1
_MIRRORED: Final = ((1.0, 0.0),)
_MOST_GAP_S: Final = 0.5  # after a longer pause the filters begin anew; what they have shown stays


class Verdict(Enum):
    """What is known so far."""

    OPEN = "the vehicle has not turned enough to tell"
    RIGHT = "the picture turns as the vehicle does"
    WRONG = "the picture does not turn as the vehicle does"


class _Filter:
    """A constant-rate Kalman filter on an angle in the picture that moves by `gain` for each radian of yaw."""

    def __init__(self, gain: float, std_rad: float) -> None:
        self._gain = gain
        self._noise = std_rad**2
        self.error = self.mean_error = 1.0  # of the prediction: squared and by its variance
        self.begin(0.0, 0.0)

    def begin(self, angle_rad: float, yaw_rad: float) -> None:
        """Only this one angle is known."""
        self._at_rad, self._rate_rps = angle_rad - self._gain * yaw_rad, 0.0
        self._variance, self._covariance, self._rate_variance = self._noise, 0.0, _RATE_STD_RPS**2

    def fuse(self, angle_rad: float, yaw_rad: float, dt_s: float, yaw_rate_rps: float) -> None:
        """This angle is seen dt_s (s) later."""
        noise = self._noise + (_LATENCY_STD_S * yaw_rate_rps) ** 2
        q = _ACCELERATION_RPS2**2
        pp = self._variance + dt_s * (2 * self._covariance + dt_s * self._rate_variance) + q * dt_s**3 / 3
        pr = self._covariance + dt_s * self._rate_variance + q * dt_s**2 / 2
        s = pp + noise
        error_rad = angle_rad - self._gain * yaw_rad - self._at_rad - self._rate_rps * dt_s
        self._at_rad += self._rate_rps * dt_s + pp / s * error_rad
        self._rate_rps += pr / s * error_rad
        self._variance, self._covariance = pp - pp * pp / s, pr - pp * pr / s
        self._rate_variance += q * dt_s - pr * pr / s
        self.error = min(error_rad**2 / s, _WORST_ERROR)
        self.mean_error += (self.error - self.mean_error) / _PICTURES


class _Channel:
    """An angle in the picture, and how well each gain foretells it."""

    def __init__(self, std_rad: float, gains: Iterable[float]) -> None:
        self._filters = {gain: _Filter(gain, std_rad) for gain in gains}

    def saw(self, angle_rad: float, yaw_rad: float, dt_s: float, yaw_rate_rps: float) -> dict[float, float]:
        """Minus the logarithm of each gain's likelihood, but for what all have in common.

        Where even the best fits badly, for the box jumps or the vehicle nods, errors count as little as that.
        """
        for each in self._filters.values():
            if dt_s > _MOST_GAP_S:
                each.begin(angle_rad, yaw_rad)
            else:
                each.fuse(angle_rad, yaw_rad, dt_s, yaw_rate_rps)
        scale = max(1.0, min(each.mean_error for each in self._filters.values()))
        return {gain: 0.5 * each.error / scale for gain, each in self._filters.items()}


class CameraCheck:
    """Give it every accepted bearing of one target. A verdict, once there, stays until `reset`."""

    def __init__(self, *, kept_centred: bool = False) -> None:
        # By the gains across and upwards: mirrored or upside down, on a gimbal, rolled one way and the other.
        self._wrong = _MIRRORED if kept_centred else (*_MIRRORED, (0.0, 0.0), (0.0, 1.0), (0.0, -1.0))
        self.reset()

    def reset(self) -> None:
        """Another target: nothing is known."""
        self.verdict = Verdict.OPEN
        self._across = _Channel(_ACROSS_STD_RAD, {-1.0} | {wrong[0] for wrong in self._wrong})
        self._upward = _Channel(_UPWARD_STD_RAD, {0.0} | {wrong[1] for wrong in self._wrong})
        self._odds = dict.fromkeys(self._wrong, 0.0)
        self._t_s = -math.inf
        self._yaw_rad = 0.0
        self._turned_rad = self._least_rad = self._most_rad = 0.0  # while bearings came

    @property
    def odds(self) -> float:
        """Logarithm of the odds of the likeliest wrong camera against the camera as configured."""
        return max(self._odds.values())

    def saw(self, bearing: BearingMeasurement, yaw_rad: float) -> Verdict:
        """A bearing, and the yaw (rad) of vehicle or gimbal at its capture time."""
        dt_s = bearing.t_capture_s - self._t_s
        if self.verdict is not Verdict.OPEN or dt_s <= 0:
            return self.verdict
        step_rad = wrap_pi(yaw_rad - self._yaw_rad)
        if dt_s <= _MOST_GAP_S:
            self._turned_rad += step_rad
            self._least_rad, self._most_rad = (
                min(self._least_rad, self._turned_rad),
                max(self._most_rad, self._turned_rad),
            )
        self._t_s, self._yaw_rad = bearing.t_capture_s, yaw_rad
        rate_rps = step_rad / dt_s if dt_s <= _MOST_GAP_S else 0.0
        across = self._across.saw(wrap_pi(bearing.azimuth_rad - yaw_rad), self._turned_rad, dt_s, rate_rps)
        upward = self._upward.saw(bearing.elevation_rad, self._turned_rad, dt_s, rate_rps)
        if dt_s <= _MOST_GAP_S:
            for wrong in self._odds:
                self._odds[wrong] += across[-1.0] + upward[0.0] - across[wrong[0]] - upward[wrong[1]]
        if self._most_rad - self._least_rad > _ENOUGH_TURN_RAD and abs(self.odds) > _ENOUGH:
            self.verdict = Verdict.WRONG if self.odds > 0 else Verdict.RIGHT
        return self.verdict

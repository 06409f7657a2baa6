"""Whether the picture turns as the vehicle does: a camera mirrored, rolled or on a gimbal is found.

Each belief predicts where the target will be seen next when the vehicle turns: it moves against the turn (the
camera as configured), with it (mirrored, or upside down), not at all (held still by a gimbal), or up or down
(on its side). All filters are of one kind, so that the target's own movement surprises them alike; only the
vehicle's turning tells them apart. Wald's sequential probability ratio test says when that is enough, and it
holds while the vehicle's turning follows from what was seen, as it does here.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import Final

from control.attitude import wrap_pi
from control.types import BearingMeasurement

_STD_RAD: Final = 0.008  # of an angle in the picture: the box's jitter and the attitude's age
_ACCELERATION_RPS2: Final = 0.1  # of the target as seen; its square times a second is the noise's density
_RATE_STD_RPS: Final = 0.3
_ENOUGH: Final = 14.0  # logarithm of the odds: one wrong verdict in a million
_ENOUGH_TURN_RAD: Final = 0.1
_WORST_ERROR: Final = 16.0  # squared and by its variance; no single picture decides
_PRIOR: Final = 5.0  # pictures that fitted as expected, before the first
_MOST_GAP_S: Final = 0.5  # after a longer pause the filters begin anew; what they have shown stays


class Verdict(Enum):
    """What is known so far."""

    OPEN = "the vehicle has not turned enough to tell"
    RIGHT = "the picture turns as the vehicle does"
    WRONG = "the picture does not turn as the vehicle does"


# Gains across and upwards: mirrored or upside down, on a gimbal, rolled one way and the other.
_WRONG: Final = ((1.0, 0.0), (0.0, 0.0), (0.0, 1.0), (0.0, -1.0))


class _Filter:
    """A constant-rate Kalman filter on an angle in the picture that moves by `gain` for each radian of yaw."""

    def __init__(self, gain: float) -> None:
        self._gain = gain
        self.errors = _PRIOR
        self.begin(0.0, 0.0)

    def begin(self, angle_rad: float, yaw_rad: float) -> None:
        """Only this one angle is known."""
        self._at_rad, self._rate_rps = angle_rad - self._gain * yaw_rad, 0.0
        self._variance, self._covariance, self._rate_variance = _STD_RAD**2, 0.0, _RATE_STD_RPS**2

    def fuse(self, angle_rad: float, yaw_rad: float, dt_s: float) -> None:
        """This angle is seen dt_s (s) later; the error of what was predicted adds to `errors`."""
        q = _ACCELERATION_RPS2**2
        pp = self._variance + dt_s * (2 * self._covariance + dt_s * self._rate_variance) + q * dt_s**3 / 3
        pr = self._covariance + dt_s * self._rate_variance + q * dt_s**2 / 2
        s = pp + _STD_RAD**2
        error_rad = angle_rad - self._gain * yaw_rad - self._at_rad - self._rate_rps * dt_s
        self._at_rad += self._rate_rps * dt_s + pp / s * error_rad
        self._rate_rps += pr / s * error_rad
        self._variance, self._covariance = pp - pp * pp / s, pr - pp * pr / s
        self._rate_variance += q * dt_s - pr * pr / s
        self.errors += min(error_rad**2 / s, _WORST_ERROR)


class CameraCheck:
    """Give it every accepted bearing of one target. A verdict, once there, stays until `reset`."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Another target: nothing is known."""
        self.verdict = Verdict.OPEN
        self._across = {gain: _Filter(gain) for gain in (-1.0, 0.0, 1.0)}
        self._upward = {gain: _Filter(gain) for gain in (-1.0, 0.0, 1.0)}
        self._pictures = _PRIOR
        self._t_s: float | None = None
        self._yaw_rad = 0.0  # turned since the first bearing
        self._turns_rad = (math.inf, -math.inf)  # the least and the most of it

    def saw(self, bearing: BearingMeasurement, yaw_rad: float) -> Verdict:
        """A bearing, and the vehicle's yaw (rad) at its capture time."""
        offset_rad = wrap_pi(bearing.azimuth_rad - yaw_rad)
        dt_s = math.inf if self._t_s is None else bearing.t_capture_s - self._t_s
        if self.verdict is not Verdict.OPEN or dt_s <= 0:
            return self.verdict
        self._t_s = bearing.t_capture_s
        self._yaw_rad += wrap_pi(yaw_rad - self._yaw_rad)
        for filters, angle_rad in ((self._across, offset_rad), (self._upward, bearing.elevation_rad)):
            for each in filters.values():
                if dt_s > _MOST_GAP_S:
                    each.begin(angle_rad, self._yaw_rad)
                else:
                    each.fuse(angle_rad, self._yaw_rad, dt_s)
        if dt_s <= _MOST_GAP_S:
            self._pictures += 1
            self._turns_rad = min(self._turns_rad[0], self._yaw_rad), max(self._turns_rad[1], self._yaw_rad)
        if self._turns_rad[1] - self._turns_rad[0] > _ENOUGH_TURN_RAD:
            odds = self.odds()
            if odds > _ENOUGH:
                self.verdict = Verdict.WRONG
            elif odds < -_ENOUGH:
                self.verdict = Verdict.RIGHT
        return self.verdict

    def odds(self) -> float:
        """Logarithm of the odds of the likeliest wrong camera; of the scale of all errors nothing is assumed."""
        across, upward = self._across, self._upward
        right = across[-1.0].errors * upward[0.0].errors
        return max(
            0.5 * self._pictures * math.log(right / (across[wrong[0]].errors * upward[wrong[1]].errors))
            for wrong in _WRONG
        )

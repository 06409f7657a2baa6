"""Glass delay estimated in flight: at which delay does the camera turn in the picture as the attitude says? Pure.

Rotation of the camera from picture to picture, measured in the pictures, is compared with the rotation that the
attitude history gives for the same interval earlier by each of a row of candidate delays. Slow differences (what
passing uneven ground adds) are filtered out of both alike. Where nothing turns, nothing is known.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from control.attitude import AttitudeBuffer
from control.camera import CameraModel, ned_from_camera
from control.image_rotation import Flow, rotation_of_flow

Array = NDArray[np.float64]

PRIOR_S: Final = 0.1
LONGEST_S: Final = 0.6  # of the candidates
_STEP_S: Final = 0.02
_AHEAD_S: Final = 2 * _STEP_S  # below zero too, so that a delay of nearly nothing lies between two of them
_CANDIDATES_S: Final = np.arange(-_AHEAD_S, LONGEST_S + _STEP_S / 2, _STEP_S)
_MEMORY_S: Final = 12.0
_SLOW_S: Final = 1.0  # changes of the rotation rate slower than that are not looked at
_GAP_S: Final = 0.5
_PATIENCE_S: Final = 1.0  # so long a picture waits for the attitude of its time
_LEAST_S: Final = 3.0  # of pictures
_KNOWN_STD_S: Final = 0.012
_LEAST_TURN_RPS: Final = 0.02  # rms of what is compared
_LEAST_CORRELATION: Final = 0.7
_CONTRADICTION: Final = 0.2  # an axis that turns as much as the others and correlates less than this
_GAIN_RANGE: Final = (0.7, 1.4)
_FASTEST_RPS: Final = 6.0  # no camera turns so; a cut in the video looks like that
_ELSEWHERE_S: Final = 0.1  # so far away from the best candidate,
_CLEARLY: Final = 2.0  # all must be so much worse: an oscillation fits at every of its periods
_COLOURED: Final = 4.0  # so many errors in a row count as one: what causes them lasts


@dataclass(frozen=True, slots=True)
class DelayEstimate:
    """delay_s: from light on the sensor to arrival of the picture; std_s: standard deviation of its error.

    known: enough rotation was seen, and the picture turned as the attitude says. Else the numbers mean nothing.
    """

    delay_s: float
    std_s: float
    known: bool


UNKNOWN: Final = DelayEstimate(PRIOR_S, math.inf, known=False)


class GlassDelayEstimator:
    """`add` each interval between pictures; read `estimate` at any time.

    The attitude is the camera's carrier's, its times and the pictures' arrival times of one clock.
    """

    def __init__(self, camera: CameraModel, attitude: AttitudeBuffer) -> None:
        self._camera = camera
        self._frd_from_camera = ned_from_camera(camera, (0.0, 0.0, 0.0))
        self._attitude = attitude
        self._waiting: deque[Flow] = deque(maxlen=64)
        self._last: tuple[float, Array] | None = None  # camera attitudes (N, 3, 3) at a time less each candidate
        self.estimate = UNKNOWN
        self._forget()

    def _forget(self) -> None:
        shape = (len(_CANDIDATES_S), 3)
        self._slow: tuple[Array, Array] | None = None  # of measured and predicted rate
        self._seen_s = 0.0
        self._measured2, self._both, self._predicted2 = np.zeros(3), np.zeros(shape), np.zeros(shape)
        self._intervals = 0.0
        self._newest_s = -math.inf

    def add(self, flow: Flow) -> None:
        """The pictures of an interval have arrived; it counts once the attitude of that time is known."""
        self._waiting.append(flow)
        attitude_s = self._attitude.newest_t_s
        while self._waiting and attitude_s is not None:
            oldest = self._waiting[0]
            if attitude_s < oldest.to_t_s + _AHEAD_S and flow.to_t_s - oldest.to_t_s < _PATIENCE_S:
                break
            self._compare(self._waiting.popleft())

    def _compare(self, flow: Flow) -> None:
        dt_s = flow.to_t_s - flow.from_t_s
        start, end = self._cameras_at(flow.from_t_s), self._cameras_at(flow.to_t_s)
        if start is None or end is None or dt_s <= 0.0:
            return
        likely = int(np.argmin(np.abs(_CANDIDATES_S - self.estimate.delay_s)))
        measured = rotation_of_flow(self._camera, flow, end[likely][2])
        if measured is None or not float(np.abs(measured).max()) < _FASTEST_RPS * dt_s:
            return
        turn = np.swapaxes(start, 1, 2) @ end
        predicted = np.stack(
            [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]]
        )
        self._correlate(measured / dt_s, predicted.T / (2.0 * dt_s), dt_s, flow.to_t_s)

    def _cameras_at(self, t_s: float) -> Array | None:
        """(candidates, 3, 3) NED from camera at t_s less each candidate delay."""
        if self._last is not None and self._last[0] == t_s:
            return self._last[1]
        angles = [self._attitude.at(t_s - delay_s) for delay_s in _CANDIDATES_S]
        if any(each is None for each in angles):
            return None
        cameras = _rotations(np.array(angles, float)) @ self._frd_from_camera
        self._last = t_s, cameras
        return cameras

    def _correlate(self, measured_rps: Array, predicted_rps: Array, dt_s: float, t_s: float) -> None:
        if self._slow is None or t_s - self._newest_s > _GAP_S:
            self._slow = measured_rps, predicted_rps
        gain = -math.expm1(-dt_s / _SLOW_S)
        slow_measured, slow_predicted = self._slow
        slow_measured = slow_measured + gain * (measured_rps - slow_measured)
        slow_predicted = slow_predicted + gain * (predicted_rps - slow_predicted)
        self._slow, self._newest_s = (slow_measured, slow_predicted), t_s
        m, p = (measured_rps - slow_measured), (predicted_rps - slow_predicted)
        kept = math.exp(-dt_s / _MEMORY_S)
        self._seen_s = kept * self._seen_s + dt_s
        self._intervals = kept * self._intervals + 1.0
        self._measured2 = kept * self._measured2 + dt_s * m * m
        self._both = kept * self._both + dt_s * m * p
        self._predicted2 = kept * self._predicted2 + dt_s * p * p
        self.estimate = self._judge()

    def _judge(self) -> DelayEstimate:
        measured2, both, predicted2 = self._measured2.sum(), self._both.sum(axis=1), self._predicted2.sum(axis=1)
        # A focal length that is a little wrong makes all rotation a little larger or smaller.
        gain = np.clip(both / np.maximum(predicted2, 1e-12), *_GAIN_RANGE)
        cost = np.maximum(measured2 - 2 * gain * both + gain**2 * predicted2, 0.0)
        best = int(np.argmin(cost))
        if self._seen_s < _LEAST_S or not 0 < best < len(cost) - 1:
            return UNKNOWN
        left, middle, right = cost[best - 1 : best + 2]
        curvature = (left - 2 * middle + right) / _STEP_S**2
        if curvature <= 0:
            return UNKNOWN
        offset = (left - right) / (2 * (left - 2 * middle + right))
        delay_s = max(float(_CANDIDATES_S[best] + offset * _STEP_S), 0.0)
        std_s = math.sqrt(2 * middle / curvature * _COLOURED / self._intervals)
        elsewhere = cost[np.abs(_CANDIDATES_S - delay_s) > _ELSEWHERE_S]
        clear = float(elsewhere.min()) > _CLEARLY * middle
        return DelayEstimate(delay_s, std_s, clear and std_s < _KNOWN_STD_S and self._agrees(best))

    def _agrees(self, best: int) -> bool:
        """Whether enough was turned, and the picture turned with it on every axis that was."""
        both, predicted2 = self._both[best], self._predicted2[best]
        product = np.sqrt(self._measured2 * predicted2)
        turned_rps = np.sqrt(predicted2 / self._seen_s)
        if math.hypot(*turned_rps) < _LEAST_TURN_RPS or both.sum() < _LEAST_CORRELATION * product.sum():
            return False
        turning = turned_rps > max(0.3 * float(turned_rps.max()), _LEAST_TURN_RPS)
        return bool(np.all(both[turning] > _CONTRADICTION * product[turning]))


def _rotations(rpy_rad: Array) -> Array:
    """(N, 3, 3) NED from FRD for (N, 3) roll, pitch, yaw: `rotation_from_rpy` for many."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy_rad).T, np.cos(rpy_rad).T
    rows = (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )
    return np.moveaxis(np.array(rows), 2, 0)

"""The estimator's idea in the picture alone: a Kalman filter on a box, for videos without lens or attitude."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# In sides of the box, so that near and far targets are alike.
MEASUREMENT_STD = 0.05
ACCELERATION_PS2 = 30.0  # a moving camera too; 10 to 100 are alike on real sequences
RATE_STD_PS = 1.0
LOG_SIZE_STD = 0.05
LOG_SIZE_ACCELERATION_PS2 = 0.3
LOG_SIZE_RATE_STD_PS = 0.2


class PixelKalman:
    """Predicts where a tracked box will be, from answers that come late (`tracker.eval.latency.Predictor`).

    State: centre x and y in px, logarithms of width and height, each with its rate, at constant rates under white
    acceleration, as `control.estimator`; there the bearings are those of the world, here the camera's motion is in it.
    """

    def __init__(self) -> None:
        # Here, because filterpy takes scipy with it: a second and more.
        from filterpy.kalman import KalmanFilter

        self._kalman: Any = KalmanFilter(dim_x=8, dim_z=4)
        self._kalman.H = np.eye(8)[::2]
        self._t_s: float | None = None

    def observe(self, t_s: float, box_xywh: Array) -> None:
        """Fuse the box (4,) x,y,w,h px of the frame taken at t_s; times rise."""
        z = np.array([*(box_xywh[:2] + box_xywh[2:] / 2), *np.log(np.maximum(box_xywh[2:], 1.0))])
        sides_px = np.exp(z[2:])
        r = np.diag(np.array([*(MEASUREMENT_STD * sides_px), LOG_SIZE_STD, LOG_SIZE_STD]) ** 2)
        kalman = self._kalman
        if self._t_s is None:
            kalman.x = np.zeros(8)
            kalman.x[::2] = z
            rates = np.array([*(RATE_STD_PS * sides_px), LOG_SIZE_RATE_STD_PS, LOG_SIZE_RATE_STD_PS])
            kalman.P = np.diag(np.stack([np.diag(r), rates**2], axis=1).ravel())
        else:
            dt_s = t_s - self._t_s
            kalman.predict(F=_transition(dt_s), Q=_process_noise(dt_s, sides_px))
            kalman.update(z, R=r)
        self._t_s = t_s

    def predict(self, t_s: float) -> Array:
        """The box (4,) x,y,w,h px at t_s, not before the newest answer; the filter stays as it is."""
        if self._t_s is None:
            raise ValueError("predict before the first box was observed")
        x = _transition(t_s - self._t_s) @ self._kalman.x
        sides_px = np.exp(x[4::2])
        return np.concatenate([x[:4:2] - sides_px / 2, sides_px])


def _transition(dt_s: float) -> Array:
    """(8, 8) constant rates over dt_s."""
    f = np.eye(8)
    f[np.arange(0, 8, 2), np.arange(1, 8, 2)] = dt_s
    return f


def _process_noise(dt_s: float, sides_px: Array) -> Array:
    """(8, 8) covariance that white acceleration adds over dt_s."""
    block = np.array([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]])
    size = LOG_SIZE_ACCELERATION_PS2
    strength = np.array([*(ACCELERATION_PS2 * sides_px), size, size]) ** 2
    return np.kron(np.diag(strength), block)

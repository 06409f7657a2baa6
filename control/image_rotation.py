"""How the camera has turned between two pictures, told by how the ground moved in them. Pure.

Frames: camera x right, y down, z along the optical axis (OpenCV). Instantaneous motion field of Longuet-Higgins
and Prazdny (1980); what flying over level ground adds to it is fitted along with the rotation, so that passing
the ground is not taken for turning.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from control.camera import CameraModel

Array = NDArray[np.float64]

FEWEST_POINTS: Final = 8
_UNDISTORT_STEPS: Final = 8
_FIT_STEPS: Final = 3
_LEAST_SCALE_PX: Final = 0.5  # errors below that are noise, whatever the others are
_AGREE_SCALES: Final = 3.0
_AGREE_FRAC: Final = 0.5  # of the points, or nothing is known
_STEP_STD: Final = 0.1  # of the way flown between two pictures, in heights above ground: a weak prior


@dataclass(frozen=True, slots=True)
class Flow:
    """Where points of the background were in one picture and are in the next: (N, 2) full-picture px (u, v).

    from_t_s, to_t_s: arrival of the two pictures, seconds of the monotonic clock.
    """

    from_t_s: float
    to_t_s: float
    from_px: Array
    to_px: Array


def rotation_of_flow(camera: CameraModel, flow: Flow, down_camera: Array) -> Array | None:
    """(3,) rotation vector of the camera (rad, camera frame) that moves the background so.

    down_camera: (3,) unit vector straight down, camera frame. None where too few points agree.
    """
    if len(flow.from_px) < FEWEST_POINTS:
        return None
    before, after = _rays(camera, flow.from_px), _rays(camera, flow.to_px)
    x, y = ((before + after) / 2).T
    moved = after - before
    # Inverse depth of level ground, in heights above it; what is seen above the horizon is far.
    nearness = np.maximum(down_camera[0] * x + down_camera[1] * y + down_camera[2], 0.0)
    zero = np.zeros_like(x)
    across = np.stack([x * y, -(1 + x * x), y, -nearness, zero, x * nearness], axis=1)
    downward = np.stack([1 + y * y, -x * y, -x, zero, -nearness, y * nearness], axis=1)
    motion, agreeing = _robust_fit(across, downward, moved, _LEAST_SCALE_PX / camera.focal_px)
    if motion is None or agreeing < _AGREE_FRAC:
        return None
    return motion[:3]


def _robust_fit(across: Array, downward: Array, moved: Array, least: float) -> tuple[Array | None, float]:
    """Reweighted least squares (Geman and McClure) for the six unknowns; and the share of points that agree."""
    weight: Array = np.ones(len(moved))
    middle = len(moved) // 2
    prior = np.diag([0.0, 0.0, 0.0, *[(least / _STEP_STD) ** 2] * 3])
    motion: Array = np.zeros(6)
    error: Array = np.zeros(len(moved))
    scale = least
    for _ in range(_FIT_STEPS):
        wa, wd = across * weight[:, None], downward * weight[:, None]
        normal = wa.T @ across + wd.T @ downward + prior
        try:
            motion = np.asarray(np.linalg.solve(normal, wa.T @ moved[:, 0] + wd.T @ moved[:, 1]), np.float64)
        except np.linalg.LinAlgError:
            return None, 0.0
        error = np.hypot(moved[:, 0] - across @ motion, moved[:, 1] - downward @ motion)
        scale = max(1.5 * float(np.partition(error, middle)[middle]), least)
        weight = 1.0 / (1.0 + (error / scale) ** 2) ** 2
    return motion, float(np.count_nonzero(error < _AGREE_SCALES * scale)) / len(moved)


def _rays(camera: CameraModel, points_px: Array) -> Array:
    """(N, 2) on the plane at z = 1, distortion undone by the fixed-point iteration of OpenCV."""
    distorted = (points_px - (camera.cx_px, camera.cy_px)) / (camera.fx_px, camera.fy_px)
    if not any(camera.distortion):
        return distorted
    k1, k2, p1, p2, k3 = camera.distortion
    rays = distorted.copy()
    for _ in range(_UNDISTORT_STEPS):
        x, y = rays.T
        r2 = x * x + y * y
        radial = np.maximum(1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 0.1)
        shift = np.stack([2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], axis=1)
        rays = (distorted - shift) / radial[:, None]
    return rays

"""How the ground would move from one lockstep picture to the next: true rotation and parallax, with errors on top."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from sitl_mocks.lens import Lens
from sitl_mocks.vehicle import Pose

Points = npt.NDArray[np.float64]

_POINTS: Final = 30
_UNEVEN_M: Final = (0.0, 0.0, 0.0, 1.0, 3.0)  # what stands on the ground is that high
_FAR_M: Final = 300.0  # what is seen above the horizon
_LEVEL: Final = 0.03  # of a unit ray's downward part: nearer to the horizon it meets the ground too far away
_NOISE_PX: Final = 0.6  # of following a corner in a copy a quarter as wide
_ASTRAY_FRAC: Final = 0.1
_ASTRAY_PX: Final = 8.0
_NEAREST_M: Final = 0.5


def ground_motion(lens: Lens, before: Pose, after: Pose, seed: int) -> tuple[Points, Points]:
    """(N, 2) px of points of the ground in two pictures; some stand out of it, some are followed wrongly."""
    rng = np.random.default_rng(seed)
    size = (lens.width_px, lens.height_px)
    pixels = rng.uniform((0.0, 0.0), size, (_POINTS, 2))
    rays = np.c_[(pixels - np.array(size) / 2) / lens.focal_px, np.ones(_POINTS)]
    into_ned = lens.camera_from_ned(before.roll_rad, before.pitch_rad, before.yaw_rad).T
    rays = rays @ into_ned.T
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    height_m = np.maximum(-before.position_ned_m[2] - rng.choice(_UNEVEN_M, _POINTS), _NEAREST_M)
    range_m = np.where(rays[:, 2] > _LEVEL, height_m / np.maximum(rays[:, 2], _LEVEL), _FAR_M)
    way_m = np.array(after.position_ned_m) - np.array(before.position_ned_m)
    seen = (rays * range_m[:, None] - way_m) @ lens.camera_from_ned(after.roll_rad, after.pitch_rad, after.yaw_rad).T
    moved = seen[:, :2] / np.maximum(seen[:, 2:], _NEAREST_M) * lens.focal_px + np.array(size) / 2
    moved += rng.normal(0.0, _NOISE_PX, moved.shape)
    astray = rng.random(_POINTS) < _ASTRAY_FRAC
    moved[astray] += rng.normal(0.0, _ASTRAY_PX, (int(astray.sum()), 2))
    return lens.distort(pixels), lens.distort(moved)

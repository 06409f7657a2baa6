"""Where things are, in Foxglove's axes.

Three frames: `home` is east, north, up from home in metres; `vehicle` is forward, left, up; `camera` is right, down,
forward, its origin where the vehicle's is.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from control.camera import Angles, Array, rotation_from_rpy
from control.types import Vec3

HOME, VEHICLE, CAMERA = "home", "vehicle", "camera"
_ENU_FROM_NED: Final = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_FRD_FROM_FLU: Final = np.diag([1.0, -1.0, -1.0])


def enu(ned: Vec3) -> dict[str, float]:
    """A vector of NED as Foxglove's x, y, z."""
    north, east, down = ned
    return {"x": east, "y": north, "z": -down}


def vehicle_rotation(attitude: Angles) -> dict[str, float]:
    """Quaternion of the vehicle in `home`; attitude: roll, pitch, yaw (rad) of FRD in NED."""
    return _quaternion(_ENU_FROM_NED @ rotation_from_rpy(*attitude) @ _FRD_FROM_FLU)


def camera_rotation(ned_from_camera: Array) -> dict[str, float]:
    """Quaternion of the camera in `home`; ned_from_camera: (3, 3) rotation."""
    return _quaternion(_ENU_FROM_NED @ ned_from_camera)


def upright() -> dict[str, float]:
    """The quaternion of what is not turned."""
    return {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


def _quaternion(rotation: Array) -> dict[str, float]:
    """Of a (3, 3) rotation, from its largest component, so that nothing small is divided by."""
    r: Any = rotation.tolist()
    squares = (  # 4 w², 4 x², 4 y², 4 z²
        1 + r[0][0] + r[1][1] + r[2][2], 1 + r[0][0] - r[1][1] - r[2][2],
        1 - r[0][0] + r[1][1] - r[2][2], 1 - r[0][0] - r[1][1] + r[2][2],
    )  # fmt: skip
    products = (  # 4 w and 4 x, y, z times each
        (squares[0], r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]),
        (r[2][1] - r[1][2], squares[1], r[0][1] + r[1][0], r[0][2] + r[2][0]),
        (r[0][2] - r[2][0], r[0][1] + r[1][0], squares[2], r[1][2] + r[2][1]),
        (r[1][0] - r[0][1], r[0][2] + r[2][0], r[1][2] + r[2][1], squares[3]),
    )
    largest = max(range(4), key=squares.__getitem__)
    scale = 2 * math.sqrt(squares[largest])
    w, x, y, z = (product / scale for product in products[largest])
    return {"x": x, "y": y, "z": z, "w": w}

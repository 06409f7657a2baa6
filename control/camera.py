"""Pixels to lines of sight and back.

Frames: camera x right, y down, z along the optical axis (OpenCV); FRD body; NED world. With a zero mount
the optical axis points forward; mount pitch below zero looks down. Rotations are yaw, then pitch, then roll.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from control.types import BearingMeasurement, TargetState

Array = NDArray[np.float64]
Angles = tuple[float, float, float]

# FRD from camera at zero mount: camera z is forward, x is right, y is down.
_FRD_FROM_CAMERA: Array = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_UNDISTORT_STEPS = 100
_UNDISTORT_TOLERANCE = 1e-9  # on the plane at z = 1
_MAX_LOG_SIZE, _MIN_LOG_SIZE = 3.0, -12.0


@dataclass(frozen=True, slots=True)
class CameraModel:
    """A pinhole camera (px), OpenCV distortion (k1, k2, p1, p2, k3) and its mount (roll, pitch, yaw; rad).

    ValueError names what is out of range. With a gimbal, replace mount_rpy_rad for each frame.
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    mount_rpy_rad: Angles = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if len(self.distortion) != 5 or len(self.mount_rpy_rad) != 3:
            raise ValueError("distortion must be five numbers and mount_rpy_rad three")
        for f in fields(self):
            value = getattr(self, f.name)
            if not np.all(np.isfinite(value)):
                raise ValueError(f"{f.name} must be finite, not {value!r}")
        for name in ("width_px", "height_px", "fx_px", "fy_px"):
            if getattr(self, name) <= 0:
                raise ValueError(f"{name} must be positive, not {getattr(self, name)!r}")

    @classmethod
    def from_hfov(
        cls,
        width_px: int,
        height_px: int,
        hfov_rad: float,
        distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0),
        mount_rpy_rad: Angles = (0.0, 0.0, 0.0),
    ) -> CameraModel:
        """Square pixels, principal point in the middle, from the horizontal field of view (rad)."""
        if not 0 < hfov_rad < math.pi:
            raise ValueError(f"hfov_rad must be between 0 and pi, not {hfov_rad!r}")
        focal_px = width_px / 2 / math.tan(hfov_rad / 2)
        centre = (width_px / 2, height_px / 2)
        return cls(width_px, height_px, focal_px, focal_px, *centre, distortion, mount_rpy_rad)

    @property
    def focal_px(self) -> float:
        """The geometric mean of both focal lengths."""
        return math.sqrt(self.fx_px * self.fy_px)

    @property
    def hfov_rad(self) -> float:
        """Horizontal field of view, distortion left out."""
        return 2 * math.atan(self.width_px / 2 / self.fx_px)

    @property
    def vfov_rad(self) -> float:
        """Vertical field of view, distortion left out."""
        return 2 * math.atan(self.height_px / 2 / self.fy_px)


def rotation_from_rpy(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Array:
    """(3, 3) rotation that takes a vector of the turned frame (FRD) into the outer one (NED): Rz Ry Rx."""
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    cy, sy = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def ned_from_camera(camera: CameraModel, attitude: Angles) -> Array:
    """(3, 3) rotation from the camera into NED, at this attitude (roll, pitch, yaw) of the vehicle."""
    mount = rotation_from_rpy(*camera.mount_rpy_rad)
    rotation: Array = rotation_from_rpy(*attitude) @ mount @ _FRD_FROM_CAMERA
    return rotation


def _distort(camera: CameraModel, x: float, y: float) -> tuple[float, float]:
    """OpenCV's model on the plane at z = 1."""
    k1, k2, p1, p2, k3 = camera.distortion
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )


def _undistort(camera: CameraModel, xd: float, yd: float) -> tuple[float, float]:
    """Fixed-point iteration of the inverse, like OpenCV's undistortPoints, but until it stands still."""
    if not any(camera.distortion):
        return xd, yd
    k1, k2, p1, p2, k3 = camera.distortion
    x, y = xd, yd
    for _ in range(_UNDISTORT_STEPS):
        r2 = x * x + y * y
        radial = max(1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 0.1)
        dx = 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        dy = p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        before = x, y
        x, y = (xd - dx) / radial, (yd - dy) / radial
        if math.dist(before, (x, y)) < _UNDISTORT_TOLERANCE:
            break
    return x, y


def ray_camera(camera: CameraModel, u_px: float, v_px: float) -> Array:
    """(3,) unit vector in the camera frame through the pixel, distortion undone."""
    x, y = _undistort(camera, (u_px - camera.cx_px) / camera.fx_px, (v_px - camera.cy_px) / camera.fy_px)
    ray = np.array([x, y, 1.0])
    unit: Array = ray / np.linalg.norm(ray)
    return unit


def line_of_sight_ned(
    camera: CameraModel, u_px: float, v_px: float, roll_rad: float, pitch_rad: float, yaw_rad: float
) -> Array:
    """(3,) unit vector in NED from the camera through the pixel, at this attitude of the vehicle."""
    sight: Array = ned_from_camera(camera, (roll_rad, pitch_rad, yaw_rad)) @ ray_camera(camera, u_px, v_px)
    return sight


def project(
    camera: CameraModel, direction_ned: Array, roll_rad: float, pitch_rad: float, yaw_rad: float
) -> tuple[float, float] | None:
    """Pixel (u, v) of a direction (3,) in NED, maybe outside the picture; None if behind the camera."""
    rotation = ned_from_camera(camera, (roll_rad, pitch_rad, yaw_rad))
    x, y, z = (float(v) for v in rotation.T @ np.asarray(direction_ned, float))
    if z <= 1e-6 * math.hypot(x, y, z) or not math.isfinite(z):
        return None
    xd, yd = _distort(camera, x / z, y / z)
    return camera.cx_px + camera.fx_px * xd, camera.cy_px + camera.fy_px * yd


def direction_ned(azimuth_rad: float, elevation_rad: float) -> Array:
    """(3,) unit vector in NED."""
    level = math.cos(elevation_rad)
    return np.array(
        [level * math.cos(azimuth_rad), level * math.sin(azimuth_rad), -math.sin(elevation_rad)],
    )


def bearing_measurement(
    camera: CameraModel,
    cx_px: float,
    cy_px: float,
    w_px: float,
    h_px: float,
    attitude: Angles,
    t_capture_s: float,
    confidence: float,
) -> BearingMeasurement:
    """A box (centre and size, px) as a line of sight, with the attitude (roll, pitch, yaw) at capture time.

    ValueError if a number is not finite, or the box is none that a picture of this size can hold.
    """
    numbers = (cx_px, cy_px, w_px, h_px, *attitude, t_capture_s, confidence)
    most_px = 4.0 * max(camera.width_px, camera.height_px)
    fits = min(w_px, h_px) > 0.0 and max(abs(cx_px), abs(cy_px), w_px, h_px) <= most_px
    if not (fits and all(map(math.isfinite, numbers))):
        raise ValueError(f"box ({cx_px}, {cy_px}, {w_px}, {h_px}) px at {t_capture_s} s is not a usable box")
    ray = ray_camera(camera, cx_px, cy_px)
    north, east, down = ned_from_camera(camera, attitude) @ ray
    # A thing off the axis looks larger by 1 / cos(angle), because its depth is less than its range.
    log_size = math.log(math.sqrt(w_px * h_px) * float(ray[2]) / camera.focal_px)
    elevation_rad = -math.asin(min(max(float(down), -1.0), 1.0))
    azimuth_rad, log_aspect = math.atan2(east, north), math.log(w_px / h_px)
    return BearingMeasurement(t_capture_s, azimuth_rad, elevation_rad, log_size, confidence, log_aspect)


def box_of(
    camera: CameraModel, target: TargetState, attitude: Angles, aspect: float = 1.0
) -> tuple[float, float, float, float] | None:
    """The filtered target as a box (cx, cy, w, h) in px, aspect = w / h; None if behind the camera."""
    direction = direction_ned(target.azimuth_rad, target.elevation_rad)
    centre = project(camera, direction, *attitude)
    if centre is None or not aspect > 0:
        return None
    cos_off_axis = float((ned_from_camera(camera, attitude).T @ direction)[2])
    log_size = min(max(target.log_size, _MIN_LOG_SIZE), _MAX_LOG_SIZE)
    size_px = math.exp(log_size) * camera.focal_px / max(cos_off_axis, 1e-3)
    return (*centre, size_px * math.sqrt(aspect), size_px / math.sqrt(aspect))

"""The mocked camera's own geometry: pinhole with OpenCV distortion, fixed mount, NED world to pixels.

Frames: camera x right, y down, z along the optical axis; FRD body; NED world. Mount pitch below zero looks down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Distortion = tuple[float, float, float, float, float]

_CAMERA_FROM_FRD = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


def ned_from_frd(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Array:
    """The rotation that turns body vectors into NED: yaw, then pitch, then roll."""
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


@dataclass(frozen=True, slots=True)
class Lens:
    """Picture size (px), horizontal field of view (rad), mount pitch (rad), distortion (k1, k2, p1, p2, k3).

    The principal point is the middle of the picture, pixels are square. Raises ValueError if out of range.
    """

    width_px: int = 640
    height_px: int = 480
    hfov_rad: float = math.radians(70)
    mount_pitch_rad: float = math.radians(-28)
    distortion: Distortion = (0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if min(self.width_px, self.height_px) < 16:
            raise ValueError(f"camera: picture of {self.width_px}x{self.height_px} px is too small")
        if not 0 < self.hfov_rad < math.radians(150):
            raise ValueError(f"camera: hfov_rad must be between 0 and 2.6, got {self.hfov_rad}")
        if not all(map(math.isfinite, (self.mount_pitch_rad, *self.distortion))):
            raise ValueError("camera: mount pitch and distortion must be finite")

    @property
    def focal_px(self) -> float:
        """Focal length."""
        return self.width_px / 2 / math.tan(self.hfov_rad / 2)

    @property
    def matrix(self) -> Array:
        """The 3x3 intrinsic matrix."""
        f = self.focal_px
        return np.array([[f, 0.0, self.width_px / 2], [0.0, f, self.height_px / 2], [0.0, 0.0, 1.0]])

    @property
    def is_distorted(self) -> bool:
        """Whether the picture differs from a pinhole's."""
        return any(self.distortion)

    def camera_from_ned(self, roll_rad: float, pitch_rad: float, yaw_rad: float) -> Array:
        """The rotation from NED into the camera frame for a vehicle attitude."""
        mount = ned_from_frd(0.0, self.mount_pitch_rad, 0.0)
        return np.asarray(_CAMERA_FROM_FRD @ mount.T @ ned_from_frd(roll_rad, pitch_rad, yaw_rad).T)

    def distort(self, pinhole_px: Array) -> Array:
        """Pinhole pixels (N, 2) to the pixels of the real picture."""
        if not self.is_distorted:
            return pinhole_px
        k1, k2, p1, p2, k3 = self.distortion
        f, centre = self.focal_px, np.array([self.width_px / 2, self.height_px / 2])
        x, y = ((pinhole_px - centre) / f).T
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.asarray(np.stack([xd, yd], axis=1) * f + centre)

    def undistorting_maps(self) -> tuple[npt.NDArray[np.int16], npt.NDArray[np.uint16]]:
        """For cv2.remap: where in a pinhole picture each pixel of the real picture is found."""
        us, vs = np.meshgrid(np.arange(self.width_px), np.arange(self.height_px))
        pixels = np.stack([us.ravel(), vs.ravel()], axis=1).astype(np.float64)[:, None]
        rays = cv2.undistortPoints(pixels, self.matrix, np.array(self.distortion), P=self.matrix)
        maps = np.asarray(rays, np.float32).reshape(self.height_px, self.width_px, 2)
        fixed, fraction = cv2.convertMaps(maps[..., 0], maps[..., 1], cv2.CV_16SC2)
        return np.asarray(fixed, np.int16), np.asarray(fraction, np.uint16)


@dataclass(frozen=True, slots=True)
class View:
    """One camera pose: rotation NED to camera, camera position in NED metres, intrinsics."""

    rotation: Array
    position_ned_m: Array
    matrix: Array

    def to_camera(self, points_ned_m: Array) -> Array:
        """(N, 3) NED points in camera coordinates, metres."""
        return np.asarray((points_ned_m - self.position_ned_m) @ self.rotation.T)

    def to_px(self, points_camera_m: Array) -> Array:
        """(N, 3) points in front of the camera to pinhole pixels (N, 2)."""
        f, cx, cy = self.matrix[0, 0], self.matrix[0, 2], self.matrix[1, 2]
        z = points_camera_m[:, 2]
        return np.stack([f * points_camera_m[:, 0] / z + cx, f * points_camera_m[:, 1] / z + cy], axis=1)

"""Where the vehicle truly is."""

from __future__ import annotations

from dataclasses import dataclass, replace

from sitl_mocks.dynamics import Vec3


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the vehicle truly is, for a rendered camera. NED metres, rad, m/s, rad/s."""

    t_s: float
    position_ned_m: Vec3
    velocity_ned_mps: Vec3
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    yaw_rate_rps: float
    camera_rpy_rad: Vec3 | None = None  # in NED, where it is on a gimbal

    @property
    def of_camera(self) -> Pose:
        """The same place with the attitude the camera's mount has: the gimbal's, or the vehicle's own."""
        if self.camera_rpy_rad is None:
            return self
        roll_rad, pitch_rad, yaw_rad = self.camera_rpy_rad
        return replace(self, roll_rad=roll_rad, pitch_rad=pitch_rad, yaw_rad=yaw_rad)

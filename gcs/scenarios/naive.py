"""What most programs do, to compare with: P on the raw box, with neither filter nor prediction nor ego-motion."""

from __future__ import annotations

import math
from typing import Final

from control.camera import CameraModel
from control.config import ControlConfig
from control.follow import FollowState
from control.modes import Confirmation, FollowMode
from control.types import TargetState, VehicleState, VelocityRequest
from gcs.audit import Audit
from gcs.flight_control import Tick
from gcs.flight_view import Sighting
from sitl_mocks.dynamics import Airframe
from tracker.box import Box

_COMMAND_S: Final = 0.02
_PHASE: Final = 0.45  # of the loop's dead time: the largest gain with at most 10 % overshoot


def gain_ps(delay_s: float, fps: float, yaw_tau_s: float) -> float:
    """The yaw gain a careful person would choose: 0.45 / (L + L_cmd + T_frame / 2 + tau / 2)."""
    return _PHASE / (delay_s + _COMMAND_S + 0.5 / fps + yaw_tau_s / 2)


def yaw_tau_s(airframe: Airframe) -> float:
    """The time constant of the vehicle's yaw-rate loop."""
    return 1.0 / airframe.yaw.gain_ps


class NaiveLaw:
    """In place of `control.follow.follow_request`; a watcher of the flight, so that it gets every box as it comes."""

    def __init__(self, yaw_gain_ps: float) -> None:
        self._yaw_gain_ps = yaw_gain_ps
        self._box: Box | None = None
        self._side_px: float | None = None  # at the confirmation

    def saw(self, sighting: Sighting) -> None:
        """A frame has been through the tracker."""
        result = sighting.seen.result
        if result is not None and result.visible:
            self._box = result.box

    def ticked(self, tick: Tick) -> None:
        """Not needed."""

    def audited(self, t_s: float, audit: Audit) -> None:
        """Not needed."""

    def __call__(
        self,
        confirmation: Confirmation,
        target: TargetState,
        vehicle: VehicleState,
        camera: CameraModel,
        now_s: float,
        state: FollowState,
        config: ControlConfig,
        *,
        velocity_factor: float = 1.0,
        **_: object,
    ) -> tuple[VelocityRequest, FollowState]:
        """Turn by what the box is off the middle; forward or back by what its size has changed."""
        box = self._box
        if box is None:
            return VelocityRequest(now_s, (0.0, 0.0, 0.0), 0.0), state
        side_px = math.sqrt(box.w_px * box.h_px)
        self._side_px = self._side_px or side_px
        off_rad = math.atan2(box.cx_px - camera.cx_px, camera.fx_px)
        limit_rps = config.follow.max_yaw_rate_rps
        yaw_rate_rps = min(max(self._yaw_gain_ps * off_rad, -limit_rps), limit_rps) * velocity_factor
        forward_mps = 0.0
        if confirmation.mode is not FollowMode.SPOTLIGHT:
            error_m = confirmation.standoff_m * (self._side_px / side_px - 1.0)
            limit_mps = config.follow.max_speed_mps
            forward_mps = min(max(config.follow.range_gain_ps * error_m, -limit_mps), limit_mps) * velocity_factor
        north, east = math.cos(vehicle.yaw_rad), math.sin(vehicle.yaw_rad)
        velocity = (forward_mps * north, forward_mps * east, 0.0)
        return VelocityRequest(now_s, velocity, yaw_rate_rps), state

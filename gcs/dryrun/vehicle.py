"""The vehicle of a dry run: imagined, armed, in the air; it takes up every mode at once and moves nowhere."""

from __future__ import annotations

from typing import NoReturn

from control.engagement import Action
from control.types import VehicleMode, VehicleState
from gcs.dryrun.rehearsal import Pose
from gcs.flight_orders import RefusedError


class ImaginedVehicle:
    """Stands where its pose says, as recorded with the video, or level and still at height_m."""

    def __init__(self, height_m: float) -> None:
        self.pose = Pose()
        self._height_m = height_m
        self._mode = VehicleMode.HOLD

    def obey(self, action: Action) -> None:
        """The mode that a decision asks for."""
        if action is Action.ENGAGE:
            self._mode = VehicleMode.EXTERNAL
        elif action is Action.COMMAND_HOLD:
            self._mode = VehicleMode.HOLD

    def state(self, now_s: float) -> VehicleState:
        """Everything it says is fresh; of its battery it says nothing."""
        pose = self.pose
        roll_rad, pitch_rad, yaw_rad = pose.attitude_rpy_rad
        return VehicleState(
            heartbeat_t_s=now_s,
            mode=self._mode,
            mode_t_s=now_s,
            armed=True,
            in_air=True,
            attitude_t_s=now_s,
            roll_rad=roll_rad,
            pitch_rad=pitch_rad,
            yaw_rad=yaw_rad,
            yaw_rate_rps=pose.yaw_rate_rps,
            position_t_s=now_s,
            position_ned_m=pose.position_ned_m,
            velocity_ned_mps=pose.velocity_ned_mps,
            height_m=self._height_m if pose.height_m is None else pose.height_m,
        )


class NoVehicle:
    """Whatever only a vehicle could do is refused."""

    async def hold(self) -> None:
        """RefusedError."""
        self.refuse()

    async def arm(self) -> None:
        """RefusedError."""
        self.refuse()

    async def takeoff(self, height_m: float) -> None:
        """RefusedError."""
        self.refuse()

    async def land(self) -> None:
        """RefusedError."""
        self.refuse()

    async def return_to_launch(self) -> None:
        """RefusedError."""
        self.refuse()

    def accept(self, name: str) -> str:
        """RefusedError."""
        self.refuse()

    def refuse(self) -> NoReturn:
        """RefusedError."""
        raise RefusedError("a dry run has no vehicle")

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
        return self.pose.vehicle(now_s, self._mode, self._height_m)


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

"""What differs between autopilots, as data: mode numbers and the streams to ask for.

Which mode is the external one depends on the backend: OFFBOARD or GUIDED, or the vehicle's own follow mode.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from control.types import VehicleMode
from gcs.backend import Backend


@dataclass(frozen=True, slots=True)
class Stream:
    """A telemetry message and how often it is wanted."""

    message_id: int
    rate_hz: float


class Autopilot(Protocol):
    """One autopilot's personality; pure, no I/O."""

    @property
    def name(self) -> str:
        """For messages to people."""
        ...

    @property
    def streams(self) -> tuple[Stream, ...]:
        """Everything to request by SET_MESSAGE_INTERVAL; nothing may be taken for granted."""
        ...

    @property
    def integers_bytewise(self) -> bool:
        """PARAM_VALUE holds an integer's bytes, not its value as a float."""
        ...

    @property
    def braking_mps2(self) -> float:
        """The hardest it brakes in external control, with its factory's settings."""
        ...

    @property
    def late_s(self) -> float:
        """How much later than PX4 it answers a step of velocity."""
        ...

    def mode_of(self, custom_mode: int) -> VehicleMode:
        """Meaning of HEARTBEAT.custom_mode or CURRENT_MODE.custom_mode; OTHER if not one we know."""
        ...

    def mode_params(self, mode: VehicleMode) -> tuple[float, float]:
        """(param2, param3) of MAV_CMD_DO_SET_MODE for EXTERNAL or HOLD; ValueError for any other."""
        ...

    def by(self, backend: Backend) -> Autopilot:
        """The same, reached in this way."""
        ...

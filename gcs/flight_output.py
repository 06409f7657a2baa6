"""How a decision leaves for the vehicle: as a velocity setpoint, or as the target for the vehicle's own follow mode."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from control.camera import CameraModel
from control.gate import Limits, Setpoint
from gcs.backend import Backend
from gcs.follow_target import FollowTargetOutput
from gcs.telemetry import Telemetry
from gcs.tick import Tick
from gcs.wire import Wire


class Output(Protocol):
    """Where `Flight` gives what it decided. Nothing leaves but by a setpoint that the gate has made."""

    @property
    def steers(self) -> bool:
        """The setpoints themselves are sent."""
        ...

    @property
    def problem(self) -> str:
        """Why no follow may begin now; empty if it may."""
        ...

    @property
    def decides(self) -> str:
        """What is not for the operator to order, in his words; empty where all is."""
        ...

    @property
    def label(self) -> str:
        """For the status line; empty for the usual way."""
        ...

    def send(self, tick: Tick) -> None:
        """One tick: send, or be silent."""
        ...

    def stop(self, setpoint: Setpoint) -> None:
        """An orderly end: the vehicle is to stop. setpoint: a zero of the gate."""
        ...

    def audited(self, values: Mapping[str, float]) -> str:
        """The vehicle's parameters have been read; what the operator must know of them, or nothing."""
        ...


class SetpointOutput:
    """SET_POSITION_TARGET_LOCAL_NED: OFFBOARD or GUIDED, every tick as the gate made it."""

    steers = True
    problem = decides = label = ""

    def __init__(self, wire: Wire) -> None:
        self._wire = wire

    def send(self, tick: Tick) -> None:
        """The setpoint of this tick."""
        if tick.setpoint is not None:
            self._wire.send_setpoint(tick.setpoint)

    def stop(self, setpoint: Setpoint) -> None:
        """The zero itself."""
        self._wire.send_setpoint(setpoint)

    def audited(self, values: Mapping[str, float]) -> str:
        """Nothing depends on them here."""
        return ""


def output_of(backend: Backend, wire: Wire, telemetry: Telemetry, camera: CameraModel, limits: Limits) -> Output:
    """The way that the configuration asks for."""
    if backend is Backend.FOLLOW_TARGET:
        return FollowTargetOutput(wire, telemetry, camera, limits)
    return SetpointOutput(wire)

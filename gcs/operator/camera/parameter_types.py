"""The camera's parameters (PARAM_EXT): what they are called, mean and allow, and how their values are written."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from control.modes import FollowMode
from gcs.flight_view import Status
from gcs.framing import Message, dialect
from gcs.operator.camera.setup import CameraSetup
from gcs.operator.orders import Abort, Confirm, Order, SetMode, SetStandoff

FOLLOW, MODE, STANDOFF, HEIGHT, SPEED = "FOLLOW", "FOLLOW_MODE", "FOLLOW_STANDOFF", "HEIGHT", "SPEED"
_VALUE_BYTES: Final = 128
_MODES: Final = tuple(FollowMode)


class Kind(IntEnum):
    """MAV_PARAM_EXT_TYPE, as far as it is used."""

    UINT8 = 1
    REAL32 = 9


class Told(IntEnum):
    """PARAM_ACK."""

    ACCEPTED = 0
    # Not FAILED: QGroundControl sends a parameter that failed again by itself, which an order must never be.
    REFUSED = 1
    IN_PROGRESS = 3


_FORMATS: Final = {Kind.UINT8: "<B", Kind.REAL32: "<f"}


class InvalidValueError(ValueError):
    """A value that the parameter cannot have; says why."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One of them; order None: it can only be read. options: names of its values. low and high: its range."""

    name: str
    kind: Kind
    text: str
    order: Callable[[float], Order] | None = None
    options: tuple[tuple[str, int], ...] = ()
    low: float = 0.0
    high: float = 0.0
    unit: str = ""

    def value_of(self, data: bytes, kind: int) -> float:
        """The value in these 128 bytes: the number as C has it in memory. InvalidValueError if it is not allowed."""
        if self.order is None:
            raise InvalidValueError(f"{self.name} can only be read")
        if kind != self.kind:
            raise InvalidValueError(f"{self.name} is of type {self.kind.name}")
        (value,) = struct.unpack_from(_FORMATS[self.kind], data)
        if self.options and value not in (number for _, number in self.options):
            raise InvalidValueError(f"{self.name} cannot be {value:g}")
        if not self.options and not (value == 0 or self.low <= value <= self.high):  # NaN neither
            raise InvalidValueError(f"{self.name} must be 0, or {self.low:g} to {self.high:g} {self.unit}")
        return float(value)

    def bytes_of(self, value: float) -> bytes:
        """The value as 128 bytes."""
        number = round(value) if self.kind is Kind.UINT8 else value
        return struct.pack(_FORMATS[self.kind], number).ljust(_VALUE_BYTES, b"\0")


def parameters(setup: CameraSetup) -> tuple[Parameter, ...]:
    """All that this camera has, in their order; FOLLOW only where the configuration allows it."""
    low_m, high_m = setup.standoff_m
    modes = tuple((mode.value.capitalize(), number) for number, mode in enumerate(_MODES))
    shown = (
        Parameter(MODE, Kind.UINT8, "Follow mode", lambda value: SetMode(_MODES[int(value)]), modes),
        Parameter(
            STANDOFF,
            Kind.REAL32,
            "Distance to hold (0: as when following begins)",
            lambda value: SetStandoff(value or None),
            low=low_m,
            high=high_m,
            unit="m",
        ),
        Parameter(HEIGHT, Kind.REAL32, "Height above home", low=-1000.0, high=10_000.0, unit="m"),
        Parameter(SPEED, Kind.REAL32, "Ground speed", high=200.0, unit="m/s"),
    )
    if not setup.may_follow:
        return shown
    switch = (("Off", 0), ("On", 1))
    return (*shown, Parameter(FOLLOW, Kind.UINT8, "Follow what is tracked", _follow, switch))


def _follow(value: float) -> Order:
    return Confirm() if value else Abort()


def value_now(name: str, status: Status, wanted_standoff_m: float) -> float:
    """What a parameter is now; what is not known is 0."""
    vehicle = status.vehicle
    known = vehicle.position_t_s is not None
    if name == FOLLOW:
        return float(status.is_engaged)
    if name == MODE:
        return float(_MODES.index(status.follow_mode))
    if name == STANDOFF:
        return wanted_standoff_m if status.standoff_m is None else round(status.standoff_m, 1)
    if not known:
        return 0.0
    return round(vehicle.height_m if name == HEIGHT else math.hypot(*vehicle.velocity_ned_mps[:2]), 1)


def value_message(parameter: Parameter, value: float, count: int, index: int) -> Message:
    """PARAM_EXT_VALUE."""
    data = parameter.bytes_of(value)
    return dialect.MAVLink_param_ext_value_message(parameter.name.encode(), data, int(parameter.kind), count, index)


def ack_message(name: bytes, data: bytes, kind: int, told: Told) -> Message:
    """PARAM_EXT_ACK."""
    return dialect.MAVLink_param_ext_ack_message(name[:16], data[:_VALUE_BYTES], kind, int(told))


def raw_value(message: Message) -> bytes:
    """All 128 bytes of param_value: pymavlink reads characters, and drops the zeros at the end."""
    return bytes(message._param_value_raw).ljust(_VALUE_BYTES, b"\0")

"""Messages of MAVLink's Gimbal v2 protocol to and from the control side's types, no I/O and no clock.

Pitch up and yaw clockwise from above are positive, rad and rad/s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from control.gimbal import GimbalLimits, GimbalRequest
from gcs import codec
from gcs.codec import VehicleId
from gcs.framing import CodecError, Message, dialect
from gcs.wire import COMPONENT_ID, SYSTEM_ID

INFORMATION: Final = dialect.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION
STATUS: Final = dialect.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS
ATTITUDE: Final = dialect.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS
CONFIGURE: Final = dialect.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE
MAX_RATE_RPS: Final = math.pi  # no configuration lifts it
_FIRST_DEVICE_COMPONENT: Final = 7  # below it are gimbals the autopilot itself speaks for
_LOCK_HORIZON: Final = dialect.GIMBAL_MANAGER_FLAGS_ROLL_LOCK | dialect.GIMBAL_MANAGER_FLAGS_PITCH_LOCK
_REMOVE_US: Final = -3.0


@dataclass(frozen=True, slots=True)
class Manager:
    """A gimbal and the component that takes commands for it."""

    vehicle: VehicleId  # with the manager's component
    device_id: int
    limits: GimbalLimits

    @property
    def device(self) -> VehicleId:
        """Where the device itself is reached."""
        if self.device_id < _FIRST_DEVICE_COMPONENT:
            return self.vehicle
        return replace(self.vehicle, component_id=self.device_id)


@dataclass(frozen=True, slots=True)
class DeviceAttitude:
    """Of the camera; from_north: the yaw counts from north, otherwise from the vehicle's nose."""

    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    from_north: bool


def manager_of(message: Message, vehicle: VehicleId) -> Manager:
    """GIMBAL_MANAGER_INFORMATION; limits that are not finite or the wrong way round count as none."""
    flags = message.cap_flags
    pitch = _span(message.pitch_min, message.pitch_max, math.pi / 2)
    yaw = _span(message.yaw_min, message.yaw_max, math.inf)
    if flags & dialect.GIMBAL_MANAGER_CAP_FLAGS_SUPPORTS_INFINITE_YAW:
        yaw = -math.inf, math.inf
    limits = GimbalLimits(
        *pitch,
        *yaw,
        has_yaw=bool(flags & dialect.GIMBAL_MANAGER_CAP_FLAGS_HAS_YAW_AXIS),
        yaw_lock=bool(flags & dialect.GIMBAL_MANAGER_CAP_FLAGS_HAS_YAW_LOCK),
    )
    at = replace(vehicle, component_id=message.get_srcComponent())
    return Manager(at, message.gimbal_device_id, limits)


def _span(low_rad: float, high_rad: float, default_rad: float) -> tuple[float, float]:
    if math.isfinite(low_rad) and math.isfinite(high_rad) and low_rad < high_rad:
        return low_rad, high_rad
    return -default_rad, default_rad


def attitude(message: Message) -> DeviceAttitude | None:
    """GIMBAL_DEVICE_ATTITUDE_STATUS; None where it is none. Older gimbals tell the yaw's frame by its lock alone."""
    norm = math.hypot(*message.q)
    if not math.isfinite(norm) or norm < 0.5:
        return None
    w, x, y, z = (part / norm for part in message.q)
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(min(max(2 * (w * y - z * x), -1.0), 1.0))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    named = message.flags & (
        dialect.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME | dialect.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
    )
    north = dialect.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME if named else dialect.GIMBAL_DEVICE_FLAGS_YAW_LOCK
    return DeviceAttitude(roll, pitch, yaw, bool(message.flags & north))


def rates(request: GimbalRequest, manager: Manager) -> Message:
    """GIMBAL_MANAGER_SET_PITCHYAW with rates only: in force at the gimbal until replaced.

    CodecError if not finite or beyond MAX_RATE_RPS.
    """
    wanted = request.pitch_rate_rps, request.yaw_rate_rps
    if not all(math.isfinite(rate) and abs(rate) <= MAX_RATE_RPS for rate in wanted):
        raise CodecError(f"gimbal rates are not usable: {request}")
    flags = _LOCK_HORIZON
    if manager.limits.has_yaw and manager.limits.yaw_lock:
        flags |= dialect.GIMBAL_MANAGER_FLAGS_YAW_LOCK
    at = manager.vehicle
    return dialect.MAVLink_gimbal_manager_set_pitchyaw_message(
        at.system_id, at.component_id, flags, manager.device_id, math.nan, math.nan, *wanted
    )


def request_information(vehicle: VehicleId) -> Message:
    """MAV_CMD_REQUEST_MESSAGE for GIMBAL_MANAGER_INFORMATION."""
    return codec.command(vehicle, dialect.MAV_CMD_REQUEST_MESSAGE, float(INFORMATION))


def take_control(manager: Manager) -> Message:
    """Primary control for us; who has secondary control keeps it."""
    us = float(SYSTEM_ID), float(COMPONENT_ID)
    return codec.command(manager.vehicle, CONFIGURE, *us, -1.0, -1.0, 0.0, 0.0, float(manager.device_id))


def give_back(manager: Manager) -> Message:
    """No control for us any more; where we have none nothing changes."""
    return codec.command(manager.vehicle, CONFIGURE, *(_REMOVE_US,) * 4, 0.0, 0.0, float(manager.device_id))

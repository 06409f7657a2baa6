"""MAVLink messages to and from the control side's types, no I/O and no clock."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from control.gate import Setpoint
from control.types import VehicleMode, VehicleState
from gcs.autopilot import Autopilot
from gcs.autopilot.ardupilot import ArduCopter
from gcs.autopilot.px4 import Px4
from gcs.framing import CodecError, Message, dialect

# SET_POSITION_TARGET_LOCAL_NED.type_mask: ignore position (7), acceleration (0x1C0) and yaw (0x400).
TYPE_MASK_VELOCITY_YAW_RATE = 0x5C7
_POSITION_AND_VELOCITY = 0b11  # FOLLOW_TARGET.est_capabilities
_MULTICOPTERS = frozenset({2, 3, 4, 13, 14, 15, 29, 35})  # MAV_TYPE: quadrotor .. decarotor, helicopters
_AUTOPILOT_COMPONENT = 1
_GCS_TYPE = 6
_ARMED = 128  # MAV_MODE_FLAG_SAFETY_ARMED
_CRITICAL = 5  # MAV_STATE_CRITICAL and above: a failsafe is active
_LANDED_IN_AIR = frozenset({2, 3, 4})  # MAV_LANDED_STATE: in air, taking off, landing

# What moves a vehicle and must come from the gate; nobody else on this side may send it.
MOVING_MESSAGES = frozenset(
    {
        dialect.MAVLINK_MSG_ID_MANUAL_CONTROL,
        dialect.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE,
        dialect.MAVLINK_MSG_ID_MANUAL_SETPOINT,
        dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
        dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
        dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
        dialect.MAVLINK_MSG_ID_SET_ACTUATOR_CONTROL_TARGET,
        dialect.MAVLINK_MSG_ID_FOLLOW_TARGET,
    }
)


@dataclass(frozen=True, slots=True)
class VehicleId:
    """The one vehicle that is flown."""

    system_id: int
    component_id: int
    autopilot: Autopilot

    def __str__(self) -> str:
        return f"{self.autopilot.name} (system {self.system_id})"


def identify(message: Message) -> VehicleId | None:
    """The multicopter that sent this HEARTBEAT; None for anything else."""
    if message.get_type() != "HEARTBEAT" or message.get_srcComponent() != _AUTOPILOT_COMPONENT:
        return None
    autopilots: Mapping[int, Autopilot] = {3: ArduCopter(), 12: Px4()}
    autopilot = autopilots.get(message.autopilot)
    if autopilot is None or message.type not in _MULTICOPTERS:
        return None
    return VehicleId(message.get_srcSystem(), message.get_srcComponent(), autopilot)


def unusable_reason(message: Message) -> str | None:
    """Why the sender of this HEARTBEAT is no vehicle for us; None if it is one, or not a vehicle at all."""
    if message.get_type() != "HEARTBEAT" or message.type == _GCS_TYPE or identify(message) is not None:
        return None
    if message.get_srcComponent() != _AUTOPILOT_COMPONENT:
        return None
    return (
        f"system {message.get_srcSystem()} is neither a PX4 nor an ArduPilot multicopter "
        f"(MAV_AUTOPILOT {message.autopilot}, MAV_TYPE {message.type})"
    )


def is_gcs_heartbeat(message: Message) -> bool:
    """A HEARTBEAT of a ground station."""
    return bool(message.get_type() == "HEARTBEAT" and message.type == _GCS_TYPE)


def heartbeat() -> Message:
    """Our own HEARTBEAT: a ground station, active."""
    return dialect.MAVLink_heartbeat_message(_GCS_TYPE, 8, 0, 0, 4, 3)


def setpoint(value: Setpoint, vehicle: VehicleId, time_boot_ms: int) -> Message:
    """SET_POSITION_TARGET_LOCAL_NED in MAV_FRAME_LOCAL_NED: velocity (m/s, NED) and yaw rate (rad/s).

    CodecError if not finite: PX4 takes a NaN silently and leaves that axis uncontrolled.
    """
    north, east, down = value.velocity_ned_mps
    if not all(map(math.isfinite, (north, east, down, value.yaw_rate_rps))):
        raise CodecError(f"setpoint is not finite: {value}")
    return dialect.MAVLink_set_position_target_local_ned_message(
        time_boot_ms & 0xFFFFFFFF,
        vehicle.system_id,
        vehicle.component_id,
        dialect.MAV_FRAME_LOCAL_NED,
        TYPE_MASK_VELOCITY_YAW_RATE,
        *(0.0, 0.0, 0.0),
        *(north, east, down),
        *(0.0, 0.0, 0.0),
        0.0,
        value.yaw_rate_rps,
    )


@dataclass(frozen=True, slots=True)
class PublishedTarget:
    """What FOLLOW_TARGET says of a target: degrees, metres above mean sea level, m/s in NED, standard deviations."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    velocity_ned_mps: tuple[float, float, float]
    std_ned_m: tuple[float, float, float]


def follow_target(value: PublishedTarget, time_boot_ms: int) -> Message:
    """FOLLOW_TARGET with position and velocity, attitude and rates unknown; CodecError if not finite."""
    numbers = (value.latitude_deg, value.longitude_deg, value.altitude_m, *value.velocity_ned_mps, *value.std_ned_m)
    if not all(map(math.isfinite, numbers)):
        raise CodecError(f"target is not finite: {value}")
    return dialect.MAVLink_follow_target_message(
        time_boot_ms,
        _POSITION_AND_VELOCITY,
        round(value.latitude_deg * 1e7),
        round(value.longitude_deg * 1e7),
        value.altitude_m,
        list(value.velocity_ned_mps),
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0],
        [std * std for std in value.std_ned_m],
        0,
    )


def command(vehicle: VehicleId, command_id: int, *params: float, confirmation: int = 0) -> Message:
    """COMMAND_LONG; parameters not given are 0."""
    padded = (*params, *(0.0,) * (7 - len(params)))
    return dialect.MAVLink_command_long_message(
        vehicle.system_id, vehicle.component_id, command_id, confirmation, *padded
    )


def set_mode(vehicle: VehicleId, mode: VehicleMode, armed: bool, confirmation: int = 0) -> Message:
    """MAV_CMD_DO_SET_MODE as MAVSDK sends it: base mode 'custom' plus the armed flag as it is."""
    base = float(dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (_ARMED if armed else 0))
    numbers = vehicle.autopilot.mode_params(mode)
    return command(vehicle, dialect.MAV_CMD_DO_SET_MODE, base, *numbers, confirmation=confirmation)


def timesync(stamp_ns: int) -> Message:
    """A TIMESYNC request; the vehicle answers with ts1 as it was."""
    return dialect.MAVLink_timesync_message(0, stamp_ns)


def set_message_interval(vehicle: VehicleId, message_id: int, rate_hz: float) -> Message:
    """MAV_CMD_SET_MESSAGE_INTERVAL; rate_hz > 0."""
    interval_us = float(round(1e6 / rate_hz))
    return command(vehicle, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, float(message_id), interval_us)


def is_from(message: Message, vehicle: VehicleId) -> bool:
    """Sent by the autopilot of this vehicle, not by another system or component."""
    return bool(message.get_srcSystem() == vehicle.system_id and message.get_srcComponent() == vehicle.component_id)


def update(state: VehicleState, message: Message, t_s: float, vehicle: VehicleId) -> VehicleState:
    """The state after this message, which arrived at t_s; unchanged if it is another's or carries nothing."""
    apply = _UPDATES.get(message.get_type())
    if apply is None or not is_from(message, vehicle):
        return state
    return apply(state, message, t_s, vehicle.autopilot)


_Update = Callable[[VehicleState, Message, float, Autopilot], VehicleState]


def _heartbeat(state: VehicleState, message: Message, t_s: float, autopilot: Autopilot) -> VehicleState:
    return replace(
        state,
        heartbeat_t_s=t_s,
        mode=autopilot.mode_of(message.custom_mode),
        mode_t_s=t_s,
        armed=bool(message.base_mode & _ARMED),
        failsafe=message.system_status >= _CRITICAL,
        braking_mps2=autopilot.braking_mps2,
        late_s=autopilot.late_s,
    )


def _current_mode(state: VehicleState, message: Message, t_s: float, autopilot: Autopilot) -> VehicleState:
    return replace(state, mode=autopilot.mode_of(message.custom_mode), mode_t_s=t_s)


def _extended_sys_state(state: VehicleState, message: Message, _t: float, _a: Autopilot) -> VehicleState:
    return replace(state, in_air=message.landed_state in _LANDED_IN_AIR)


def _attitude(state: VehicleState, message: Message, t_s: float, _a: Autopilot) -> VehicleState:
    values = (message.roll, message.pitch, message.yaw, message.yawspeed)
    if not all(map(math.isfinite, values)):
        return state
    roll, pitch, yaw, yaw_rate = values
    return replace(state, attitude_t_s=t_s, roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw, yaw_rate_rps=yaw_rate)


def _local_position(state: VehicleState, message: Message, t_s: float, _a: Autopilot) -> VehicleState:
    position = (message.x, message.y, message.z)
    velocity = (message.vx, message.vy, message.vz)
    if not all(map(math.isfinite, position + velocity)):
        return state
    return replace(state, position_t_s=t_s, position_ned_m=position, velocity_ned_mps=velocity)


def _global_position(state: VehicleState, message: Message, _t: float, _a: Autopilot) -> VehicleState:
    return replace(state, height_m=message.relative_alt / 1000.0)


def _battery(state: VehicleState, message: Message, _t: float, _a: Autopilot) -> VehicleState:
    if not 0 <= message.battery_remaining <= 100 or getattr(message, "id", 0) != 0:
        return state
    return replace(state, battery_frac=message.battery_remaining / 100.0)


_UPDATES: Mapping[str, _Update] = MappingProxyType(
    {
        "HEARTBEAT": _heartbeat,
        "CURRENT_MODE": _current_mode,
        "EXTENDED_SYS_STATE": _extended_sys_state,
        "ATTITUDE": _attitude,
        "LOCAL_POSITION_NED": _local_position,
        "GLOBAL_POSITION_INT": _global_position,
        "SYS_STATUS": _battery,
        "BATTERY_STATUS": _battery,
    }
)

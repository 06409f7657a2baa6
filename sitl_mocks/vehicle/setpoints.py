"""SET_POSITION_TARGET_LOCAL_NED as the two autopilots were measured to take it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from sitl_mocks.dynamics import Vec3, body_to_ned
from sitl_mocks.vehicle.modes import Personality

LOCAL_NED, LOCAL_OFFSET_NED, BODY_NED, BODY_OFFSET_NED = 1, 7, 8, 9
BODY_FRAMES = (BODY_NED, BODY_OFFSET_NED)
_FRAMES = {
    Personality.PX4: (LOCAL_NED, BODY_NED),
    Personality.ARDUPILOT: (LOCAL_NED, LOCAL_OFFSET_NED, BODY_NED, BODY_OFFSET_NED),
}
_YAW_IGNORE, _YAW_RATE_IGNORE = 1 << 10, 1 << 11


class BadSetpointError(ValueError):
    """The autopilot does not use this message; the text is what PX4 says in STATUSTEXT."""


@dataclass(frozen=True, slots=True)
class Setpoint:
    """An accepted setpoint in NED. NaN = not controlled; position_ned_m None = a velocity setpoint."""

    t_s: float
    velocity_ned_mps: Vec3
    position_ned_m: Vec3 | None
    yaw_rad: float | None
    yaw_rate_rps: float


def parse_setpoint(message: Any, personality: Personality, yaw_rad: float, now_s: float) -> Setpoint:
    """A SET_POSITION_TARGET_LOCAL_NED as the vehicle will fly it.

    Body frames are turned by the yaw at reception, level. Raises BadSetpointError for what the autopilot
    does not take: other frames, a mask that ignores everything, and on ArduCopter any NaN.
    """
    frame, mask = message.coordinate_frame, message.type_mask
    if frame not in _FRAMES[personality]:
        raise BadSetpointError(f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {frame} unsupported")
    position = _masked((message.x, message.y, message.z), mask)
    velocity = _masked((message.vx, message.vy, message.vz), mask >> 3)
    accel = _masked((message.afx, message.afy, message.afz), mask >> 6)
    yaw = math.nan if mask & _YAW_IGNORE else message.yaw
    yaw_rate = math.nan if mask & _YAW_RATE_IGNORE else message.yaw_rate
    if frame != LOCAL_NED:
        position = (math.nan,) * 3
    if personality is Personality.ARDUPILOT and _asked_but_nan(message):
        raise BadSetpointError("NaN")
    if all(math.isnan(v) for v in (*position, *velocity, *accel)):
        raise BadSetpointError("SET_POSITION_TARGET_LOCAL_NED invalid")
    whole_position = position if all(map(math.isfinite, position)) else None
    return Setpoint(
        t_s=now_s,
        velocity_ned_mps=_velocity(velocity, frame, yaw_rad),
        position_ned_m=whole_position,
        yaw_rad=yaw if math.isfinite(yaw) else None,
        yaw_rate_rps=yaw_rate if math.isfinite(yaw_rate) else 0.0,
    )


def _masked(values: Vec3, mask: int) -> Vec3:
    x, y, z = (math.nan if mask >> axis & 1 else value for axis, value in enumerate(values))
    return x, y, z


def _velocity(velocity: Vec3, frame: int, yaw_rad: float) -> Vec3:
    # Body to NED mixes both horizontal axes, so one NaN leaves both uncontrolled, as measured on PX4.
    velocity = (
        velocity[0] if not math.isinf(velocity[0]) else math.nan,
        velocity[1] if not math.isinf(velocity[1]) else math.nan,
        velocity[2] if not math.isinf(velocity[2]) else math.nan,
    )
    if frame in BODY_FRAMES:
        return body_to_ned(velocity, yaw_rad)
    return velocity


def _asked_but_nan(message: Any) -> bool:
    motion = (message.x, message.y, message.z, message.vx, message.vy, message.vz)
    values = (*motion, message.afx, message.afy, message.afz)
    if any(not message.type_mask >> bit & 1 and not math.isfinite(v) for bit, v in enumerate(values)):
        return True
    yaw_asked = not message.type_mask & _YAW_IGNORE and not math.isfinite(message.yaw)
    rate_asked = not message.type_mask & _YAW_RATE_IGNORE and not math.isfinite(message.yaw_rate)
    return yaw_asked or rate_asked

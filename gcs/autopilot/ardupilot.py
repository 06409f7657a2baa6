"""ArduCopter: custom_mode is the flight mode's number (AP mode.h); GUIDED or FOLLOW is external."""

from __future__ import annotations

from dataclasses import dataclass, replace

from control.types import VehicleMode
from gcs.autopilot import Stream
from gcs.backend import Backend
from gcs.framing import dialect

GUIDED, LOITER, RTL, LAND, BRAKE, FOLLOW = 4, 5, 6, 9, 17, 23
_EXTERNAL = {Backend.SETPOINTS: GUIDED, Backend.FOLLOW_TARGET: FOLLOW}
_BY_PILOT = frozenset({0, 1, 2, 11, 13, 16, 22})  # STABILIZE ACRO ALT_HOLD DRIFT SPORT POSHOLD FLOWHOLD
_MODES = {
    LOITER: VehicleMode.HOLD,
    BRAKE: VehicleMode.HOLD,
    RTL: VehicleMode.RETURN,
    21: VehicleMode.RETURN,  # SMART_RTL
    27: VehicleMode.RETURN,  # AUTO_RTL
    LAND: VehicleMode.LAND,
}

STREAMS = (
    Stream(dialect.MAVLINK_MSG_ID_ATTITUDE, 50.0),
    Stream(dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 20.0),
    Stream(dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 20.0),
    Stream(dialect.MAVLINK_MSG_ID_HEARTBEAT, 5.0),  # carries the mode; also sent at once on a change
    Stream(dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, 5.0),
    Stream(dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED, 10.0),
    Stream(dialect.MAVLINK_MSG_ID_SYS_STATUS, 2.0),
    Stream(dialect.MAVLINK_MSG_ID_BATTERY_STATUS, 1.0),
    Stream(dialect.MAVLINK_MSG_ID_HOME_POSITION, 0.5),
)


@dataclass(frozen=True, slots=True)
class ArduCopter:
    """The ArduCopter personality."""

    name: str = "ArduCopter"
    streams: tuple[Stream, ...] = STREAMS
    integers_bytewise: bool = False
    braking_mps2: float = 2.5  # WPNAV_ACCEL
    late_s: float = 0.4  # measured: 0.49 + 0.59 s, PX4 0.20 + 0.48 s
    backend: Backend = Backend.SETPOINTS

    def mode_of(self, custom_mode: int) -> VehicleMode:
        """VehicleMode of the flight mode's number."""
        if custom_mode == _EXTERNAL[self.backend]:
            return VehicleMode.EXTERNAL
        if custom_mode in _BY_PILOT:
            return VehicleMode.MANUAL
        return _MODES.get(custom_mode, VehicleMode.OTHER)

    def mode_params(self, mode: VehicleMode) -> tuple[float, float]:
        """GUIDED 4, FOLLOW 23, BRAKE 17."""
        # BRAKE, not LOITER: with the throttle stick low LOITER was measured to sink into the ground at 2.5 m/s.
        numbers = {VehicleMode.EXTERNAL: _EXTERNAL[self.backend], VehicleMode.HOLD: BRAKE}
        if mode not in numbers:
            raise ValueError(f"ArduCopter is never put into {mode.value} by this station")
        return float(numbers[mode]), 0.0

    def by(self, backend: Backend) -> ArduCopter:
        """The same, reached in this way."""
        return replace(self, backend=backend)

"""PX4: custom_mode = main << 16 | sub << 24 (px4_custom_mode.h); OFFBOARD or AUTO_FOLLOW_TARGET is external."""

from __future__ import annotations

from dataclasses import dataclass, replace

from control.types import VehicleMode
from gcs.autopilot import Stream
from gcs.backend import Backend
from gcs.framing import dialect

MAIN_AUTO, MAIN_OFFBOARD = 4, 6
_EXTERNAL = {Backend.SETPOINTS: (MAIN_OFFBOARD, 0), Backend.FOLLOW_TARGET: (MAIN_AUTO, 8)}
_HOLD = (MAIN_AUTO, 3)
_MAIN_BY_PILOT = frozenset({1, 2, 3, 5, 7, 8})  # MANUAL ALTCTL POSCTL ACRO STABILIZED RATTITUDE
_AUTO = {
    2: VehicleMode.TAKEOFF,
    3: VehicleMode.HOLD,
    5: VehicleMode.RETURN,
    6: VehicleMode.LAND,
    9: VehicleMode.LAND,  # precision landing
    10: VehicleMode.TAKEOFF,  # VTOL
}

STREAMS = (
    Stream(dialect.MAVLINK_MSG_ID_ATTITUDE, 50.0),
    Stream(dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 20.0),
    Stream(dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 20.0),
    # PX4's heartbeat comes once a second and not on a mode change: this is how a pilot's is seen within 100 ms.
    Stream(dialect.MAVLINK_MSG_ID_CURRENT_MODE, 50.0),
    Stream(dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, 5.0),
    Stream(dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED, 10.0),
    Stream(dialect.MAVLINK_MSG_ID_SYS_STATUS, 2.0),
    Stream(dialect.MAVLINK_MSG_ID_BATTERY_STATUS, 1.0),
    Stream(dialect.MAVLINK_MSG_ID_HOME_POSITION, 0.5),
)


@dataclass(frozen=True, slots=True)
class Px4:
    """The PX4 personality."""

    name: str = "PX4"
    streams: tuple[Stream, ...] = STREAMS
    integers_bytewise: bool = True
    braking_mps2: float = 9.0  # it limits the tilt alone
    late_s: float = 0.0
    backend: Backend = Backend.SETPOINTS

    def mode_of(self, custom_mode: int) -> VehicleMode:
        """VehicleMode of main and sub mode."""
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        if (main, sub if main == MAIN_AUTO else 0) == _EXTERNAL[self.backend]:
            return VehicleMode.EXTERNAL
        if main == MAIN_AUTO:
            return _AUTO.get(sub, VehicleMode.OTHER)
        return VehicleMode.MANUAL if main in _MAIN_BY_PILOT else VehicleMode.OTHER

    def mode_params(self, mode: VehicleMode) -> tuple[float, float]:
        """OFFBOARD 6/0, AUTO_FOLLOW_TARGET 4/8, AUTO_LOITER 4/3."""
        numbers = {VehicleMode.EXTERNAL: _EXTERNAL[self.backend], VehicleMode.HOLD: _HOLD}
        if mode not in numbers:
            raise ValueError(f"PX4 is never put into {mode.value} by this station")
        main, sub = numbers[mode]
        return float(main), float(sub)

    def by(self, backend: Backend) -> Px4:
        """The same, reached in this way."""
        return replace(self, backend=backend)

"""Flight modes with the numbers each autopilot gives them on the wire (measured, HEARTBEAT.custom_mode)."""

from __future__ import annotations

from enum import Enum, IntEnum


class Personality(Enum):
    """Which autopilot the vehicle behaves like."""

    PX4 = "px4"
    ARDUPILOT = "ardupilot"


class Mode(Enum):
    """Flight modes of both autopilots; a personality knows a subset."""

    STABILIZE = "stabilize"
    ALTITUDE = "altitude"
    POSITION = "position"
    EXTERNAL = "external"  # PX4 OFFBOARD, ArduCopter GUIDED
    HOLD = "hold"  # PX4 AUTO_LOITER, ArduCopter LOITER (which obeys the sticks)
    BRAKE = "brake"
    MISSION = "mission"
    TAKEOFF = "takeoff"
    RETURN = "return"
    LAND = "land"
    FOLLOW = "follow"  # its own: PX4 AUTO_FOLLOW_TARGET, ArduCopter FOLLOW


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6


class Landed(IntEnum):
    """MAV_LANDED_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


class Severity(IntEnum):
    """MAV_SEVERITY."""

    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6


def px4_custom_mode(main: int, sub: int = 0) -> int:
    """PX4's custom_mode: main mode in bits 16-23, sub mode in bits 24-31."""
    return main << 16 | sub << 24


PX4_NUMBERS = {
    Mode.STABILIZE: px4_custom_mode(7),
    Mode.ALTITUDE: px4_custom_mode(2),
    Mode.POSITION: px4_custom_mode(3),
    Mode.EXTERNAL: px4_custom_mode(6),
    Mode.TAKEOFF: px4_custom_mode(4, 2),
    Mode.HOLD: px4_custom_mode(4, 3),
    Mode.MISSION: px4_custom_mode(4, 4),
    Mode.RETURN: px4_custom_mode(4, 5),
    Mode.LAND: px4_custom_mode(4, 6),
    Mode.FOLLOW: px4_custom_mode(4, 8),
}
ARDUPILOT_NUMBERS = {
    Mode.STABILIZE: 0,
    Mode.ALTITUDE: 2,
    Mode.MISSION: 3,
    Mode.EXTERNAL: 4,
    Mode.HOLD: 5,
    Mode.RETURN: 6,
    Mode.LAND: 9,
    Mode.POSITION: 16,
    Mode.BRAKE: 17,
    Mode.FOLLOW: 23,
}
STICK_MODES = frozenset({Mode.STABILIZE, Mode.ALTITUDE, Mode.POSITION})
AUTO_MODES = frozenset({Mode.TAKEOFF, Mode.HOLD, Mode.MISSION, Mode.RETURN, Mode.LAND, Mode.FOLLOW})


def numbers(personality: Personality) -> dict[Mode, int]:
    """The custom_mode of each mode the personality has."""
    return PX4_NUMBERS if personality is Personality.PX4 else ARDUPILOT_NUMBERS

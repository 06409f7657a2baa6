"""Messages of the control side, standard library only. Times are seconds of one monotonic clock.

Frames: NED = north, east, down, origin at home; FRD = forward, right, down of the vehicle's body.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

Vec3 = tuple[float, float, float]


class VehicleMode(Enum):
    """Flight modes as far as following cares; each autopilot adapter maps its own numbers onto these."""

    EXTERNAL = "external"  # PX4 OFFBOARD, ArduCopter GUIDED: the vehicle obeys our setpoints
    HOLD = "hold"  # PX4 AUTO_LOITER, ArduCopter BRAKE or LOITER
    TAKEOFF = "takeoff"
    LAND = "land"
    RETURN = "return"
    MANUAL = "manual"  # any mode flown by the pilot's sticks
    OTHER = "other"
    UNKNOWN = "unknown"  # nothing heard yet


@dataclass(frozen=True, slots=True)
class VehicleState:
    """The newest telemetry, each part with the time it arrived (s); None = never heard."""

    heartbeat_t_s: float | None = None
    mode: VehicleMode = VehicleMode.UNKNOWN
    mode_t_s: float | None = None
    armed: bool = False
    in_air: bool = False
    failsafe: bool = False
    attitude_t_s: float | None = None
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    yaw_rate_rps: float = 0.0
    position_t_s: float | None = None
    position_ned_m: Vec3 = (0.0, 0.0, 0.0)
    velocity_ned_mps: Vec3 = (0.0, 0.0, 0.0)
    height_m: float = 0.0  # above home, from relative altitude
    battery_frac: float | None = None
    # What its autopilot makes of a velocity setpoint, whatever is asked: the hardest it brakes, and how much later than
    # PX4 it answers.
    braking_mps2: float = 9.0
    late_s: float = 0.0


@dataclass(frozen=True, slots=True)
class BearingMeasurement:
    """A tracked box as a line of sight at the frame's capture time.

    azimuth_rad: from north, clockwise seen from above. elevation_rad: above the horizon is positive.
    log_size: ln(sqrt(box area in px²) * cos(angle off the optical axis) / focal length in px), so that it is
    ln(object size / slant range) wherever in the picture the box stands. confidence: 0..1 of the tracker.
    log_aspect: ln(width / height) of the box; where it is left at 0 nothing is known of what covers the target.
    """

    t_capture_s: float
    azimuth_rad: float
    elevation_rad: float
    log_size: float
    confidence: float
    log_aspect: float = 0.0


@dataclass(frozen=True, slots=True)
class TargetState:
    """The filtered line of sight, predicted to t_s."""

    t_s: float
    azimuth_rad: float
    azimuth_rate_rps: float
    elevation_rad: float
    elevation_rate_rps: float
    log_size: float
    log_size_rate_ps: float
    azimuth_std_rad: float
    azimuth_rate_std_rps: float
    log_size_std: float
    confidence: float  # of the newest accepted measurement
    measured_t_s: float  # capture time of the newest accepted measurement
    rejections_in_a_row: int
    elevation_std_rad: float = 0.0
    log_size_rate_std_ps: float = 0.0
    # How far the newest box was taken for the whole target: towards 0 its size, or its elevation, was covered.
    size_trust: float = 1.0
    elevation_trust: float = 1.0
    log_aspect: float | None = None  # ln(width / height) of the whole box; None: not known


@dataclass(frozen=True, slots=True)
class VelocityRequest:
    """What a follow law wants; only the gate turns it into a Setpoint."""

    t_s: float
    velocity_ned_mps: Vec3
    yaw_rate_rps: float
    limited_by: tuple[str, ...] = ()  # names of the limits that are clipping, for the operator
    # True: a zero that may be sent before the vehicle is in EXTERNAL (PX4 wants a stream before it switches).
    priming: bool = False


class Reason(Enum):
    """Why the gate answered as it did: passed, trimmed, zero or nothing sent."""

    PASSED = "passed"
    SPEED = "trimmed: speed or yaw rate"
    ALTITUDE = "trimmed: height floor or ceiling"
    FENCE = "trimmed: fence"
    SLEW = "trimmed: acceleration"
    PRIMING = "zero: before the mode change"
    REQUEST_STALE = "zero: request too old"
    REQUEST_INVALID = "zero: request not finite"
    TELEMETRY_STALE = "zero: attitude or position too old or not finite"
    AT_FENCE = "zero: at or outside the fence"
    GAP = "zero: our own stream had a gap"
    LIMIT_JUMPED = "zero: a limit moved faster than may be followed"
    NO_REQUEST = "silent: nothing requested"
    BAD_CALL = "silent: clock, vehicle or limits unusable"
    HEARTBEAT_STALE = "silent: heartbeat or mode too old"
    NOT_OURS = "silent: the mode is not external control"
    NOT_ARMED = "silent: not armed"
    FAILSAFE = "silent: the vehicle has a failsafe active"

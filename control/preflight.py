"""What the state machine looks at, and every cause that can be told from it at one moment."""

from __future__ import annotations

from dataclasses import dataclass, field

from control.causes import Cause
from control.checks import fresh
from control.config import EngagementConfig
from control.types import VehicleMode, VehicleState


@dataclass(frozen=True, slots=True)
class Inputs:
    """All the state machine looks at in one tick. Times: arrival, seconds of the monotonic clock.

    measured_t_s: when the estimator last accepted a measurement. request_t_s: of the newest follow request.
    latency_s: age of the picture behind the newest measurement when it became a command. late_t_s: of the last
    tick of our own that came too late. Last come the operator's acts, each True in one tick only.
    """

    vehicle: VehicleState = field(default_factory=VehicleState)
    frame_t_s: float | None = None
    selected: bool = False
    measured_t_s: float | None = None
    rejections_in_a_row: int = 0
    confidence: float = 0.0
    distance_known: bool = True
    latency_s: float | None = None
    attitude_rate_hz: float = 0.0
    request_t_s: float | None = None
    outside_fence: bool = False
    audit_ok: bool = True
    late_t_s: float | None = None
    camera_wrong: bool = False  # the picture does not turn as the vehicle does
    echo_lost: bool = False  # the vehicle says that it follows something older than what we send
    foreign_setpoints: bool = False  # the vehicle says that it follows what we never sent
    lossy: bool = False  # much of the telemetry is lost
    foreign_station: bool = False
    select: bool = False
    confirm: bool = False
    abort: bool = False
    acknowledge: bool = False


def conditions(inputs: Inputs, now_s: float, config: EngagementConfig) -> tuple[Cause, ...]:
    """Every cause that holds now and needs no memory, in the order of the table."""
    vehicle, battery = inputs.vehicle, inputs.vehicle.battery_frac
    checks = (
        (Cause.NOT_SELECTED, inputs.selected),
        (Cause.NO_VIDEO, video_ok(inputs, now_s, config)),
        (Cause.NO_TARGET, target_seen(inputs, now_s, config)),
        (Cause.LOW_CONFIDENCE, inputs.confidence >= config.confirm_confidence),
        (Cause.NO_DISTANCE, inputs.distance_known),
        (Cause.LATENCY, latency_ok(inputs, config)),
        (Cause.ATTITUDE_SLOW, inputs.attitude_rate_hz >= config.min_attitude_rate_hz),
        (Cause.LINK_LOST, link_ok(inputs, now_s, config)),
        (Cause.TELEMETRY_STALE, telemetry_ok(inputs, now_s, config)),
        (Cause.NOT_ARMED, vehicle.armed),
        (Cause.NOT_IN_AIR, vehicle.in_air),
        (Cause.TOO_LOW, vehicle.height_m >= config.min_height_m),
        (Cause.MODE, vehicle.mode in (VehicleMode.HOLD, VehicleMode.EXTERNAL)),
        (Cause.FAILSAFE, not vehicle.failsafe),
        (Cause.BATTERY, battery is None or battery >= config.min_battery_frac),
        (Cause.OUTSIDE_FENCE, not inputs.outside_fence),
        (Cause.AUDIT, inputs.audit_ok),
        (Cause.OWN_LAG, not fresh(inputs.late_t_s, now_s, config.lag_quiet_s)),
        (Cause.CAMERA_WRONG, not inputs.camera_wrong),
        (Cause.ECHO_LOST, not inputs.echo_lost),
        (Cause.FOREIGN_SETPOINTS, not inputs.foreign_setpoints),
        (Cause.LOSSY, not inputs.lossy),
        (Cause.FOREIGN_STATION, not inputs.foreign_station),
    )
    return tuple(cause for cause, fine in checks if not fine)


def refusals(inputs: Inputs, now_s: float, config: EngagementConfig) -> tuple[Cause, ...]:
    """Every reason not to start following now; empty = all green."""
    return tuple(cause for cause in conditions(inputs, now_s, config) if cause.refuses)


def video_ok(inputs: Inputs, now_s: float, config: EngagementConfig) -> bool:
    """Whether a frame has arrived within target_age_s."""
    return fresh(inputs.frame_t_s, now_s, config.target_age_s)


def target_seen(inputs: Inputs, now_s: float, config: EngagementConfig) -> bool:
    """Whether the estimator accepted something of late and its picture was not an old one."""
    measured = fresh(inputs.measured_t_s, now_s, config.target_age_s)
    agreeing = inputs.rejections_in_a_row < config.max_rejections
    return measured and agreeing and latency_ok(inputs, config)


def latency_ok(inputs: Inputs, config: EngagementConfig) -> bool:
    """Whether the glass-to-command time is known and small enough."""
    return inputs.latency_s is not None and 0 <= inputs.latency_s <= config.max_latency_s


def link_ok(inputs: Inputs, now_s: float, config: EngagementConfig) -> bool:
    """Whether heartbeat and mode are fresh."""
    vehicle = inputs.vehicle
    return all(fresh(t, now_s, config.heartbeat_age_s) for t in (vehicle.heartbeat_t_s, vehicle.mode_t_s))


def telemetry_ok(inputs: Inputs, now_s: float, config: EngagementConfig) -> bool:
    """Whether attitude and position are fresh."""
    vehicle = inputs.vehicle
    return all(fresh(t, now_s, config.telemetry_age_s) for t in (vehicle.attitude_t_s, vehicle.position_t_s))

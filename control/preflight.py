"""What a follow needs before it starts: every reason to refuse, not only the first."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from control.config import EngagementConfig
from control.gate_limits import fresh
from control.types import VehicleMode, VehicleState


class Cause(Enum):
    """Why the state machine refuses or stops, in the operator's words."""

    NOT_SELECTED = "no target is selected"
    NO_VIDEO = "no fresh video"
    NO_TARGET = "the target is not being measured"
    LOW_CONFIDENCE = "the tracker is not sure enough of the target"
    NO_DISTANCE = "the distance to the target is unknown: type it"
    LATENCY = "the picture reaches the controls too late"
    ATTITUDE_SLOW = "attitude arrives too slowly"
    LINK_LOST = "no heartbeat from the vehicle"
    TELEMETRY_STALE = "attitude or position is too old"
    NOT_ARMED = "the vehicle is not armed"
    NOT_IN_AIR = "the vehicle is not in the air"
    TOO_LOW = "the vehicle is too low"
    MODE = "the vehicle is neither in hold nor in external control"
    FAILSAFE = "the vehicle has a failsafe active"
    BATTERY = "the battery is too low"
    OUTSIDE_FENCE = "the vehicle is at or outside the fence"
    AUDIT = "the vehicle's parameters are not safe for following"
    ACKNOWLEDGE = "the last follow ended by itself: acknowledge or select again first"
    # From here on reasons to stop only.
    ABORT = "the operator stopped it"
    MODE_CHANGED = "the pilot or the vehicle changed the mode"
    TARGET_LOST = "the target was lost for too long"
    TARGET_UNSEEN = "the target is not seen"
    OWN_GAP = "our own program paused"
    STALLED = "the controller stopped asking"
    MODE_REFUSED = "the vehicle did not take up external control"
    HOLD_REFUSED = "the vehicle did not take up hold"


@dataclass(frozen=True, slots=True)
class Inputs:
    """All the state machine looks at in one tick. Times: arrival, seconds of the monotonic clock.

    measured_t_s: when the estimator last accepted a measurement. request_t_s: of the newest follow request.
    latency_s: age of the picture behind the newest measurement when it became a command. Last come the
    operator's acts, each True in one tick only.
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
    select: bool = False
    confirm: bool = False
    abort: bool = False
    acknowledge: bool = False


def refusals(inputs: Inputs, now_s: float, config: EngagementConfig) -> tuple[Cause, ...]:
    """Every reason not to start following now; empty = all green."""
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
    )
    return tuple(cause for cause, fine in checks if not fine)


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

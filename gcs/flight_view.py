"""What people and files get to see of a flight: status, live line, overlay; made of facts, deciding nothing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Protocol

from control.attitude import AttitudeBuffer
from control.camera import CameraModel, box_of
from control.config import FollowConfig
from control.engagement import State
from control.latency import UNKNOWN, DelayEstimate
from control.modes import Confirmation, FollowMode, ground_distance_m
from control.motion import distance_m
from control.types import BearingMeasurement, TargetState, VehicleState
from gcs import hud
from gcs.audit import Audit
from gcs.flight_vision import Seen
from gcs.latency_budget import Budget
from gcs.tick import Tick
from tracker.box import Box

if TYPE_CHECKING:  # a dry run has no link, and imports none
    from gcs.telemetry import Telemetry
    from gcs.wire import Wire

_TONES: Mapping[State, hud.Tone] = MappingProxyType(
    {
        State.NO_VIDEO: hud.Tone.ALARM,
        State.IDLE: hud.Tone.CALM,
        State.SELECTED: hud.Tone.CALM,
        State.FOLLOWING: hud.Tone.GOOD,
        State.COASTING: hud.Tone.CAUTION,
        State.LOST_HOLD: hud.Tone.CAUTION,
        State.RELEASED: hud.Tone.ALARM,
        State.TAKEN_OVER: hud.Tone.ALARM,
    }
)


@dataclass(frozen=True, slots=True)
class Status:
    """Everything an operator's display needs; None = not known."""

    t_s: float
    state: State
    engaging: bool
    reasons: tuple[str, ...]
    vehicle: VehicleState
    confidence: float | None
    distance_m: float | None
    standoff_m: float | None
    video_fps: float
    limited_by: tuple[str, ...]
    warnings: tuple[str, ...] = ()
    link: str = ""
    way: str = ""  # by which the vehicle is flown, where it is not the usual one
    budget: Budget | None = None  # from light to command, over the last second
    glass_delay: DelayEstimate = UNKNOWN
    follow_mode: FollowMode = FollowMode.FOLLOW  # held, or what the next confirmation asks for
    selection: int = 0  # counts selections; 0: nothing is selected
    frame_t_s: float | None = None  # arrival of the newest picture
    recording: bool | None = None  # whether a film is being made; None: it cannot be

    @property
    def is_engaged(self) -> bool:
        """The vehicle is ours to move, or about to be."""
        return self.engaging or self.state in (State.FOLLOWING, State.COASTING, State.LOST_HOLD)

    @property
    def tone(self) -> hud.Tone:
        """How urgent the state is."""
        return _TONES[self.state]

    @property
    def headline(self) -> str:
        """The state in capitals, with what is behind it."""
        name = "ENGAGING" if self.engaging else self.state.value.upper()
        return f"{name}: {self.reasons[0]}" if self.reasons else name


def status_line(status: Status) -> str:
    """One line of text for a terminal."""
    vehicle = status.vehicle
    parts = [status.headline, vehicle.mode.value, "armed" if vehicle.armed else "disarmed"]
    if status.way:
        parts.append(status.way)
    if vehicle.position_t_s is not None:
        parts.append(f"{vehicle.height_m:.1f} m high")
    if vehicle.battery_frac is not None:
        parts.append(f"bat {vehicle.battery_frac:.0%}")
    if status.confidence is not None:
        parts.append(f"conf {status.confidence:.2f}")
    if status.distance_m is not None:
        wanted = f"/{status.standoff_m:.1f}" if status.standoff_m is not None else ""
        parts.append(f"dist {status.distance_m:.1f}{wanted} m")
    if status.budget is not None:
        parts.append(str(status.budget))
    parts.append(f"{status.video_fps:.0f} fps")
    if status.link:
        parts.append(status.link)
    if status.limited_by:
        parts.append("limited: " + ", ".join(status.limited_by))
    return " · ".join((*parts, *(f"! {warning}" for warning in status.warnings)))


@dataclass(frozen=True, slots=True)
class Sighting:
    """One frame with everything that is known of it.

    predicted: the filter's box at capture time. t_saw_s: when control was given it; None: it was not in a flight.
    """

    seen: Seen
    status: Status
    measurement: BearingMeasurement | None
    predicted: Box | None
    t_saw_s: float | None = None


class Watcher(Protocol):
    """Is told of every frame and every tick, on the event loop; must not wait and must not raise."""

    def saw(self, sighting: Sighting) -> None:
        """A frame has been through the tracker."""
        ...

    def ticked(self, tick: Tick) -> None:
        """A decision has been made, and what it let through has been sent."""
        ...

    def audited(self, t_s: float, audit: Audit) -> None:
        """The vehicle's parameters have been judged, with another result than before."""
        ...


def make_status(
    now_s: float,
    tick: Tick | None,
    vehicle: VehicleState,
    confirmation: Confirmation | None,
    follow: FollowConfig,
    video_fps: float,
    warnings: tuple[str, ...] = (),
    link: str = "",
) -> Status:
    """The status after this tick."""
    if tick is None:
        return Status(now_s, State.NO_VIDEO, False, (), vehicle, None, None, None, video_fps, (), warnings, link)
    tracked = tick.inputs.selected and tick.inputs.latency_s is not None
    return Status(
        t_s=now_s,
        state=tick.output.state,
        engaging=tick.output.engaging,
        reasons=tuple(cause.value for cause in tick.output.reasons),
        vehicle=vehicle,
        confidence=tick.inputs.confidence if tracked else None,
        distance_m=target_distance_m(tick.target, vehicle, confirmation, follow) if tracked else None,
        standoff_m=(confirmation.standoff_goal_m or confirmation.standoff_m) if confirmation is not None else None,
        video_fps=video_fps,
        limited_by=tick.request.limited_by if tick.request is not None else (),
        warnings=warnings,
        link=link,
    )


def link_summary(wire: Wire, now_s: float) -> str:
    """What goes over the link each way, and whether it is signed."""
    figures = wire.figures(now_s)
    kind = "unsigned link" if wire.signing is None else "signed link"
    return f"in {figures.received_bytes_per_s / 1000:.1f} out {figures.sent_bytes_per_s / 1000:.1f} kB/s, {kind}"


def link_warnings(wire: Wire, telemetry: Telemetry, now_s: float) -> tuple[str, ...]:
    """What is not heard of the vehicle, and what is heard of others, though flying may still do."""
    from gcs.telemetry import LINK_LOST_S

    heard_s = telemetry.vehicle_state().heartbeat_t_s
    if heard_s is None or now_s - heard_s > LINK_LOST_S:
        return ("nothing is heard of the vehicle",)
    found = []
    if missing := telemetry.missing_streams(now_s):
        found.append(f"missing: {', '.join(missing)}")
    if others := wire.other_vehicles(now_s):
        found.append(f"ignored: {', '.join(others)}")
    if wire.signing is not None and (alarm := wire.signing.alarm(now_s)):
        found.append(alarm)
    return tuple(found)


def target_distance_m(
    target: TargetState | None, vehicle: VehicleState, confirmation: Confirmation | None, follow: FollowConfig
) -> float | None:
    """Ground distance as it is followed by, or could be; None where it is not known."""
    if target is None:
        return None
    if confirmation is not None:
        return distance_m(confirmation, target)
    return ground_distance_m(target, vehicle, follow)


def predicted_box(
    camera: CameraModel, attitude: AttitudeBuffer, target: TargetState | None, t_capture_s: float, like: Box
) -> Box | None:
    """The filter's target at a frame's capture time, projected into the frame; shaped like the tracker's box."""
    angles = attitude.at(t_capture_s)
    if target is None or angles is None:
        return None
    found = box_of(camera, target, angles, like.w_px / like.h_px if like.is_valid else 1.0)
    if found is None or not all(map(math.isfinite, found)):
        return None
    return Box(*found)


def overlay(sighting: Sighting, watermark: str | None) -> hud.Overlay:
    """What stands on the picture."""
    status, result = sighting.status, sighting.seen.result
    vehicle = status.vehicle
    lines = [f"{vehicle.mode.value}  {vehicle.height_m:.1f} m high  {math.hypot(*vehicle.velocity_ned_mps):.1f} m/s"]
    if status.reasons:
        lines.append("; ".join(status.reasons))
    if status.limited_by:
        lines.append("limited: " + ", ".join(status.limited_by))
    if status.budget is not None:
        lines.append(f"{status.budget.parts_ms} ms")
    error_m = None
    if status.is_engaged and status.distance_m is not None and status.standoff_m is not None:
        error_m = status.distance_m - status.standoff_m
    return hud.Overlay(
        state="ENGAGING" if status.engaging else status.state.value.upper(),
        tone=_TONES[status.state],
        box=result.box if result is not None and result.visible else None,
        predicted=sighting.predicted,
        confidence=result.confidence if result is not None else None,
        distance_m=status.distance_m,
        standoff_error_m=error_m,
        latency_s=status.budget.total_s if status.budget is not None else None,
        watermark=watermark,
        lines=tuple(lines),
    )

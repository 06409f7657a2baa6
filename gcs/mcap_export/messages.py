"""Messages of our own where no type of the flight's fits: decision, frame and latency as one wants to plot them."""

from __future__ import annotations

from dataclasses import astuple

import msgspec

from control.types import Vec3
from gcs.latency_budget import Budget
from gcs.replay.log import FrameRow, TickRow
from tracker.box import Box


class Decision(msgspec.Struct, frozen=True):
    """One tick, 20 times a second: the state, why, what was done, and what the vehicle was at."""

    state: str
    action: str
    engaging: bool
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]
    selected: bool
    confidence: float
    velocity_factor: float
    gate: str
    limited_by: tuple[str, ...]
    follow_mode: str
    standoff_m: float | None
    distance_m: float | None
    vehicle_mode: str
    armed: bool
    in_air: bool

    @classmethod
    def of(cls, row: TickRow, distance_m: float | None) -> Decision:
        """distance_m: to the target, over ground."""
        output, inputs, held = row.output, row.inputs, row.held
        return cls(
            state=output.state.value,
            action=output.action.value,
            engaging=output.engaging,
            reasons=tuple(cause.value for cause in output.reasons),
            warnings=tuple(cause.value for cause in output.warnings),
            selected=inputs.selected,
            confidence=inputs.confidence,
            velocity_factor=output.velocity_factor,
            gate=row.gate.value,
            limited_by=row.request.limited_by if row.request is not None else (),
            follow_mode=(held.mode if held is not None else row.wanted.mode).value,
            standoff_m=held.standoff_m if held is not None else None,
            distance_m=distance_m,
            vehicle_mode=inputs.vehicle.mode.value,
            armed=inputs.vehicle.armed,
            in_air=inputs.vehicle.in_air,
        )


class Setpoint(msgspec.Struct, frozen=True):
    """A velocity over ground and a yaw rate: as the follow law asked for it, or as it left."""

    velocity_ned_mps: Vec3
    yaw_rate_rps: float
    speed_mps: float


class TrackedFrame(msgspec.Struct, frozen=True):
    """A picture and what the tracker said of it. ages in s; packet: of the film; predicted: the filter's box."""

    seq: int | None
    packet: int | None
    selection: int
    box: Box | None
    predicted: Box | None
    confidence: float | None
    score: float | None
    visible: bool | None
    frozen: bool
    repeated: bool
    problem: str | None
    glass_s: float
    decode_s: float
    track_s: float
    age_s: float

    @classmethod
    def of(cls, seq: int | None, row: FrameRow) -> TrackedFrame:
        """As it was logged."""
        tracked = row.tracked
        return cls(
            seq=seq,
            packet=row.packet,
            selection=row.selection,
            box=tracked.box if tracked is not None else None,
            predicted=row.predicted,
            confidence=tracked.confidence if tracked is not None else None,
            score=tracked.score if tracked is not None else None,
            visible=tracked.visible if tracked is not None else None,
            frozen=row.frozen,
            repeated=row.repeated,
            problem=row.problem,
            glass_s=row.t_arrival_s - row.t_capture_s,
            decode_s=row.decode_s,
            track_s=row.track_s,
            age_s=row.t_done_s - row.t_capture_s,
        )


class Latency(msgspec.Struct, frozen=True):
    """From the light on the sensor to the command at the vehicle, ms, by its parts."""

    glass_ms: float
    decode_ms: float
    wait_ms: float
    track_ms: float
    control_ms: float
    link_ms: float
    total_ms: float

    @classmethod
    def of(cls, budget: Budget) -> Latency:
        """In ms."""
        return cls(*(1000 * spent_s for spent_s in (*astuple(budget), budget.total_s)))

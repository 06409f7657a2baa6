"""The flight's own chain of thought without a vehicle: box, bearing, filter, follow law, gate, would-be setpoint.

Pure: time comes with the frames. There is no wire anywhere near. The vehicle is imagined: it hovers, armed, in
external control, and does not obey, so what comes out is what would have been asked at that moment. The
operator is imagined too: confirms as soon as every check is green, and again after each release.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import assert_never

from control.camera import Angles, CameraModel, bearing_measurement, box_of
from control.causes import Cause
from control.engagement import Action, Engagement, Output, State
from control.estimator import TargetEstimator
from control.follow import FollowState, follow_request
from control.gate import Setpoint, gate
from control.gate_limits import TICK_S
from control.limits import priming_request, zero_request
from control.modes import Confirmation, ConfirmError, FollowMode, confirm
from control.motion import distance_m
from control.preflight import Inputs
from control.types import (
    BearingMeasurement,
    Reason,
    TargetState,
    Vec3,
    VehicleMode,
    VehicleState,
    VelocityRequest,
)
from gcs.config import Config
from tracker.box import Box, TrackResult

ASSUMED_DISTANCE_M = 20.0
MAX_GAP_S = 5.0


@dataclass(frozen=True, slots=True)
class Pose:
    """The vehicle as recorded with the video, or level and still. NED, metres, radians."""

    attitude_rpy_rad: Angles = (0.0, 0.0, 0.0)
    yaw_rate_rps: float = 0.0
    position_ned_m: Vec3 = (0.0, 0.0, 0.0)
    velocity_ned_mps: Vec3 = (0.0, 0.0, 0.0)
    height_m: float | None = None

    def vehicle(self, now_s: float, mode: VehicleMode, height_m: float) -> VehicleState:
        """A vehicle that is there, armed and in the air, at height_m where none was recorded; all it says is fresh."""
        roll_rad, pitch_rad, yaw_rad = self.attitude_rpy_rad
        return VehicleState(
            heartbeat_t_s=now_s,
            mode=mode,
            mode_t_s=now_s,
            armed=True,
            in_air=True,
            attitude_t_s=now_s,
            roll_rad=roll_rad,
            pitch_rad=pitch_rad,
            yaw_rad=yaw_rad,
            yaw_rate_rps=self.yaw_rate_rps,
            position_t_s=now_s,
            position_ned_m=self.position_ned_m,
            velocity_ned_mps=self.velocity_ned_mps,
            height_m=height_m if self.height_m is None else self.height_m,
        )


@dataclass(frozen=True, slots=True)
class WouldBe:
    """What the gate would have let through at t_s; a record, nothing that any wire takes."""

    t_s: float
    velocity_ned_mps: Vec3
    yaw_rate_rps: float
    reason: Reason


@dataclass(frozen=True, slots=True)
class Tick:
    """One 20 Hz moment: state, prediction, the law's request and what the gate made of it."""

    t_s: float
    state: State
    causes: tuple[Cause, ...]
    target: TargetState | None
    request: VelocityRequest | None
    would_be: WouldBe | None


@dataclass(frozen=True, slots=True)
class View:
    """The rehearsal right after a frame, for the picture and the log."""

    state: State
    measurement: BearingMeasurement
    accepted: bool
    target: TargetState | None
    predicted: Box | None
    distance_m: float | None
    standoff_m: float | None


class Rehearsal:
    """For each frame in order: `advance` to its time, giving the 20 Hz ticks before it, then `observe` it."""

    def __init__(self, camera: CameraModel, config: Config) -> None:
        self._camera = camera
        self._config = config
        self._estimator = TargetEstimator(config.control.estimator)
        self._engagement = Engagement(config.control.engagement)
        self._state = State.SELECTED
        self._confirmation: Confirmation | None = None
        self._follow_state: FollowState | None = None
        self._previous: Setpoint | None = None
        self._request_t_s: float | None = None
        self._frame_t_s: float | None = None
        self._first_tick_s: float | None = None
        self._ticks = 0
        self._pose = Pose()
        self.distance_was_assumed = False

    def advance(self, now_s: float) -> list[Tick]:
        """All ticks due before now_s, with what was known until then."""
        if self._first_tick_s is None or now_s - self._due_s > MAX_GAP_S:
            self._first_tick_s, self._ticks = now_s, 0
        ticks = []
        while self._due_s < now_s:
            ticks.append(self._tick(self._due_s))
            self._ticks += 1
        return ticks

    @property
    def _due_s(self) -> float:
        """When the next tick is due, counted from the first so that no rounding adds up."""
        return (self._first_tick_s or 0.0) + self._ticks * TICK_S

    def observe(self, t_s: float, result: TrackResult, pose: Pose) -> View:
        """Take the tracker's result of the frame captured at t_s. Raises ValueError for an unusable box."""
        self._pose, self._frame_t_s = pose, t_s
        box = result.box
        centre_and_size = (box.cx_px, box.cy_px, box.w_px, box.h_px)
        measurement = bearing_measurement(self._camera, *centre_and_size, pose.attitude_rpy_rad, t_s, result.confidence)
        accepted = result.visible and self._estimator.update(measurement)
        target = self._estimator.predict(t_s)
        return View(
            state=self._state,
            measurement=measurement,
            accepted=accepted,
            target=target,
            predicted=self._predicted_box(target, box),
            distance_m=distance_m(self._confirmation, target) if self._confirmation and target else None,
            standoff_m=self._confirmation.standoff_m if self._confirmation else None,
        )

    def _tick(self, now_s: float) -> Tick:
        vehicle = self._vehicle(now_s)
        target = self._estimator.predict(now_s + self._config.control.follow.lead_s)
        output = self._engagement.update(now_s, self._inputs(vehicle, target))
        self._state = output.state
        if output.state in (State.FOLLOWING, State.COASTING, State.LOST_HOLD):
            if self._confirmation is None and target is not None:
                self._confirmation = self._confirm(target, vehicle, now_s)
        else:
            self._confirmation, self._follow_state = None, None
        request = self._request(output, target, vehicle, now_s)
        would_be = None if request is None else self._gated(request, vehicle, now_s)
        return Tick(now_s, output.state, output.reasons, target, request, would_be)

    def _inputs(self, vehicle: VehicleState, target: TargetState | None) -> Inputs:
        """Everything green but the target itself: what a recorded video can tell."""
        return Inputs(
            vehicle=vehicle,
            frame_t_s=self._frame_t_s,
            selected=True,
            measured_t_s=target.measured_t_s if target else None,
            rejections_in_a_row=target.rejections_in_a_row if target else 0,
            confidence=target.confidence if target else 0.0,
            latency_s=0.0,
            attitude_rate_hz=20.0,
            request_t_s=self._request_t_s,
            confirm=True,
            acknowledge=True,
        )

    def _request(
        self, output: Output, target: TargetState | None, vehicle: VehicleState, now_s: float
    ) -> VelocityRequest | None:
        match output.action:
            case Action.NONE | Action.SILENCE:
                return None
            case Action.ENGAGE:
                return priming_request(now_s)
            case Action.SEND_ZERO | Action.COMMAND_HOLD:
                self._follow_state = None
                return zero_request(now_s)
            case Action.SEND_REQUEST:
                return self._followed(output, target, vehicle, now_s)
            case _:
                assert_never(output.action)

    def _followed(
        self, output: Output, target: TargetState | None, vehicle: VehicleState, now_s: float
    ) -> VelocityRequest:
        if self._confirmation is None or target is None:
            return zero_request(now_s)
        request, self._follow_state = follow_request(
            self._confirmation,
            target,
            vehicle,
            self._camera,
            now_s,
            self._follow_state or FollowState.at_rest(now_s),
            self._config.control,
            velocity_factor=output.velocity_factor,
            coasting=output.state is State.COASTING,
        )
        self._request_t_s = now_s
        return request

    def _gated(self, request: VelocityRequest, vehicle: VehicleState, now_s: float) -> WouldBe | None:
        setpoint, reason = gate(request, vehicle, now_s, self._previous, self._config.control.limits)
        self._previous = setpoint
        if setpoint is None:
            return None
        return WouldBe(now_s, setpoint.velocity_ned_mps, setpoint.yaw_rate_rps, reason)

    def _confirm(self, target: TargetState, vehicle: VehicleState, now_s: float) -> Confirmation:
        """With an assumed distance where the recording cannot tell it."""
        wanted, follow = self._config.follow, self._config.control.follow
        mode = FollowMode(wanted.mode.value)
        try:
            return confirm(
                mode,
                target,
                vehicle,
                now_s,
                follow,
                distance_m=wanted.distance_m,
                standoff_m=wanted.standoff_m,
            )
        except ConfirmError:
            self.distance_was_assumed = True
            lenient = replace(follow, min_distance_m=1.5, max_distance_m=200.0)
            return confirm(mode, target, vehicle, now_s, lenient, distance_m=ASSUMED_DISTANCE_M)

    def _vehicle(self, now_s: float) -> VehicleState:
        """The imagined vehicle: everything it says is fresh, it is ours, and it is where it was recorded."""
        state = self._pose.vehicle(now_s, VehicleMode.EXTERNAL, self._config.vehicle.takeoff_height_m)
        return replace(state, battery_frac=1.0)

    def _predicted_box(self, target: TargetState | None, like: Box) -> Box | None:
        if target is None:
            return None
        found = box_of(self._camera, target, self._pose.attitude_rpy_rad, like.w_px / like.h_px)
        if found is None or not all(map(math.isfinite, found)):
            return None
        return Box(*found)

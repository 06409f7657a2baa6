"""The deciding part of a flight: what was seen and what the vehicle says in, one setpoint a tick out. Pure.

A tick always runs the same way: estimator, state machine, follow law, gate. Nothing here waits, sends or
reads a clock, so a flight can be flown again from its log.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import assert_never

from control.attitude import AttitudeBuffer
from control.camera import CameraModel
from control.config import ControlConfig
from control.engagement import Action, Engagement, Inputs, Output, State
from control.fence import Fence
from control.follow import FollowState, follow_request
from control.gate import TICK_S, Setpoint, gate
from control.gimbal import GimbalRequest, GimbalState, Pointing
from control.limits import after_setpoint, priming_request, zero_request
from control.modes import Confirmation, ConfirmError, confirm
from control.overrun import leaves_fence
from control.preflight import refusals
from control.ranging import lead_range
from control.setpoint_echo import EchoMonitor
from control.types import BearingMeasurement, TargetState, VehicleMode, VehicleState, VelocityRequest
from gcs.flight_sight import Sight
from gcs.flight_vision import Seen
from gcs.latency_budget import LatencyMeter
from gcs.link_health import LinkHealth
from gcs.tick import Act, Tick, Wanted

__all__ = ["Act", "FollowControl", "Tick", "Wanted"]

Law = Callable[..., tuple[VelocityRequest, FollowState]]  # as `follow_request`


class FollowControl:
    """Everything between the tracker and the wire. `now_s` must be the wire's own clock."""

    def __init__(
        self,
        config: ControlConfig,
        camera: CameraModel,
        attitude: AttitudeBuffer,
        *,
        on_gimbal: bool = False,
        steers: bool = True,
        delay_given: bool = True,
    ) -> None:
        """attitude: the camera's where it is on a gimbal, else the vehicle's.

        steers: False where the vehicle flies by its own follow mode and a setpoint only permits it. delay_given: see
        `Sight`.
        """
        self._steers = steers
        self._config = config
        self._pointing = Pointing(config.gimbal) if on_gimbal else None
        self.gimbal: GimbalState | None = None  # as of the next tick
        self._drawn, self._home_deg = config.limits.fence, (0.0, 0.0)
        self.fence_problem = "the fence is given in degrees, and the vehicle's home is not known yet"
        centred = on_gimbal or not steers
        self.sight = Sight(config.estimator, camera, attitude, kept_centred=centred, delay_given=delay_given)
        self._engagement = Engagement(config.engagement)
        self._echo = EchoMonitor()
        self._last_tick_s: float | None = None
        self._acts: set[Act] = set()
        self._selection = 0
        self._inputs = Inputs()
        self._latency = LatencyMeter(config.follow.lead_s - TICK_S / 2)
        self._follow = FollowState.at_rest(0.0)
        self._previous: Setpoint | None = None
        self.confirm_problem = ""
        self._engaged = False
        self.wanted = Wanted()
        self.law: Law = follow_request  # another one to measure this one against
        self.audit_ok = True  # False: the vehicle's parameters are not safe, no follow may begin
        self.confirmation: Confirmation | None = None
        self._changed: Confirmation | None = None

    @property
    def is_engaged(self) -> bool:
        """The vehicle is ours to move, or about to be."""
        return self._engaged

    @property
    def fence(self) -> Fence:
        """As it is kept, a fence in degrees once it has its place."""
        return self._config.limits.fence

    def home_at(self, latitude_deg: float, longitude_deg: float) -> None:
        """The vehicle says where its home is: a fence given in degrees gets its place around it."""
        if not self._drawn.polygon_deg or self._home_deg == (latitude_deg, longitude_deg):
            return
        self._home_deg = latitude_deg, longitude_deg
        try:
            fence, self.fence_problem = self._drawn.placed(latitude_deg, longitude_deg), ""
        except ValueError as error:
            fence, self.fence_problem = self._drawn, str(error)
        self._config = replace(self._config, limits=replace(self._config.limits, fence=fence))

    def act(self, act: Act) -> None:
        """The operator's act, judged in the next tick."""
        self._acts.add(act)

    def change(self, confirmation: Confirmation) -> None:
        """The operator wants what is followed to be followed otherwise."""
        self.confirmation = self._changed = confirmation

    def select(self, number: int) -> None:
        """The operator has drawn box `number` (0: none): what was known of a target is forgotten."""
        self._selection = number
        self.sight.reset()
        self._inputs = replace(
            self._inputs,
            selected=number > 0,
            measured_t_s=None,
            confidence=0.0,
            latency_s=None,
            camera_wrong=False,
        )
        self._latency.forget()
        if number:
            self.act(Act.SELECT)

    def saw(self, seen: Seen, now_s: float) -> BearingMeasurement | None:
        """A frame has been through the tracker; the line of sight it gave, whether or not the filter took it."""
        if seen.repeated:
            return None
        if not seen.frozen:
            self._inputs = replace(self._inputs, frame_t_s=seen.frame.t_arrival_s)
        if seen.selection != self._selection:
            return None
        sighted = self.sight.saw(seen)
        if sighted is None:
            return None
        measurement, accepted = sighted
        self._inputs = replace(
            self._inputs,
            measured_t_s=now_s if accepted else self._inputs.measured_t_s,
            rejections_in_a_row=self.sight.estimator.rejections_in_a_row,
            confidence=measurement.confidence,
            camera_wrong=self.sight.camera_is_wrong,
        )
        self._latency.saw(seen)
        return measurement

    def tick(self, now_s: float, vehicle: VehicleState, link: LinkHealth | None = None) -> Tick:
        """Decide what leaves now. `setpoint` must be sent at once, or never. link: None where nothing is known."""
        link = link or LinkHealth()
        self._watch(now_s, vehicle, link)
        budget = self._latency.answered(now_s, link.one_way_s)
        if budget is not None:
            self._inputs = replace(self._inputs, latency_s=budget.total_s)
        target = self.sight.estimator.predict(now_s + self._latency.link_s + TICK_S / 2)
        candidate = self._candidate(target, vehicle, now_s)
        acts, self._acts = self._acts, set()
        inputs = replace(
            self._as_of(now_s, vehicle, candidate is not None or target is None),
            select=Act.SELECT in acts,
            confirm=Act.CONFIRM in acts,
            abort=Act.ABORT in acts,
            acknowledge=Act.ACKNOWLEDGE in acts,
        )
        was_engaged = self._engaged
        output = self._engagement.update(now_s, inputs)
        self._engaged = output.engaging or output.state in (State.FOLLOWING, State.COASTING, State.LOST_HOLD)
        if self._engaged and not was_engaged:
            self.confirmation, self._follow = candidate, FollowState.at_rest(now_s)
            self._inputs = replace(self._inputs, request_t_s=None)
        request = self._request(output, target, vehicle, now_s)
        setpoint, reason = gate(request, vehicle, now_s, self._previous, self._config.limits)
        if setpoint is not None:
            shaping = after_setpoint(self._follow.shaping, setpoint.velocity_ned_mps, setpoint.yaw_rate_rps)
            self._follow = replace(self._follow, shaping=shaping)
            if self._steers:
                self._echo.sent(now_s, setpoint.velocity_ned_mps)
        self._previous = setpoint
        gimbal = self._point(output, target, vehicle, now_s)
        motion, held = self._follow.motion, self.confirmation if self._engaged else None
        changed, self._changed = self._changed, None
        return Tick(
            now_s, inputs, output, target, request, setpoint, reason, self.gimbal, gimbal, budget, motion, held,
            self.wanted, changed,
        )  # fmt: skip

    def _watch(self, now_s: float, vehicle: VehicleState, link: LinkHealth) -> None:
        """What this tick tells about ourselves and the link."""
        last_s, self._last_tick_s = self._last_tick_s, now_s
        late = last_s is not None and now_s - last_s > self._config.engagement.request_age_s
        if vehicle.mode is VehicleMode.EXTERNAL:
            echo = link.echo
            self._echo.judge(now_s, *((None, (0.0, 0.0, 0.0)) if echo is None else (echo.t_s, echo.velocity_ned_mps)))
        else:
            self._echo.reset()
        self._inputs = replace(
            self._inputs,
            late_t_s=now_s if late else self._inputs.late_t_s,
            echo_lost=self._echo.is_lost or link.unheard,
            foreign_setpoints=self._echo.is_foreign,
            lossy=link.lossy,
            foreign_station=link.foreign_station,
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
                return zero_request(now_s)
            case Action.SEND_REQUEST:
                return self._follow_law(output, target, vehicle, now_s)
            case _:
                assert_never(output.action)

    def _follow_law(
        self, output: Output, target: TargetState | None, vehicle: VehicleState, now_s: float
    ) -> VelocityRequest:
        if target is None or self.confirmation is None:
            return zero_request(now_s)
        if output.state is State.FOLLOWING:
            follow = self._config.follow
            self.confirmation = lead_range(self.confirmation, target, vehicle, TICK_S, follow).led(TICK_S, follow)
        request, self._follow = self.law(
            self.confirmation,
            target,
            vehicle,
            self.sight.camera,
            now_s,
            self._follow,
            self._config,
            velocity_factor=output.velocity_factor,
            coasting=output.state is State.COASTING,
            gimbal=self.gimbal,
        )
        self._inputs = replace(self._inputs, request_t_s=now_s)
        return request

    def _point(
        self, output: Output, target: TargetState | None, vehicle: VehicleState, now_s: float
    ) -> GimbalRequest | None:
        """The gimbal turns only while the law is asked for the vehicle's velocity too."""
        if self._pointing is None or not self._engaged:
            return None
        if output.action is not Action.SEND_REQUEST or target is None or self.gimbal is None:
            return self._pointing.rest(now_s)
        return self._pointing.follow(target, self.gimbal, vehicle, now_s, output.velocity_factor)

    def zero(self, now_s: float, vehicle: VehicleState) -> Setpoint | None:
        """The stop of an orderly end, through the gate like everything else; None where it must be silent."""
        setpoint, _ = gate(zero_request(now_s), vehicle, now_s, self._previous, self._config.limits)
        self._previous = setpoint
        return setpoint

    def refusals(self, now_s: float, vehicle: VehicleState) -> tuple[str, ...]:
        """Everything that would keep a confirmation from being accepted now."""
        target = self.sight.estimator.predict(now_s)
        known = self._candidate(target, vehicle, now_s) is not None
        inputs = self._as_of(now_s, vehicle, known or target is None)
        causes = [cause.value for cause in refusals(inputs, now_s, self._config.engagement)]
        if self._config.limits.fence.polygon_deg:
            causes.append(self.fence_problem)
        return (*causes, *([self.confirm_problem] if target is not None and not known else []))

    def predict(self, t_s: float) -> TargetState | None:
        """The target at t_s, for display."""
        return self.sight.estimator.predict(t_s)

    def _candidate(self, target: TargetState | None, vehicle: VehicleState, now_s: float) -> Confirmation | None:
        """What would be remembered if the operator confirmed now."""
        if target is None:
            return None
        wanted = self.wanted
        try:
            return confirm(
                wanted.mode, target, vehicle, now_s, self._config.follow,
                distance_m=wanted.distance_m, standoff_m=wanted.standoff_m,
            )  # fmt: skip
        except ConfirmError as error:
            self.confirm_problem = str(error)
            return None

    def _as_of(self, now_s: float, vehicle: VehicleState, distance_known: bool) -> Inputs:
        """What was gathered, with what the vehicle and the operator's settings say now."""
        return replace(
            self._inputs,
            vehicle=vehicle,
            distance_known=distance_known,
            attitude_rate_hz=self.sight.attitude.rate_hz(now_s),
            outside_fence=leaves_fence(vehicle, self._config.limits, steered=self._steers),
            audit_ok=self.audit_ok,
        )

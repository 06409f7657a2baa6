"""The follow state machine: when the vehicle may be moved. Pure; one call of update per 20 Hz tick.

Order of judgement in every engaged state, worst first: abort, mode or arming changed (latched, silence),
a gap of our own, link, telemetry, fence, stalled requests, and last the target. Only FOLLOWING and, fading
to zero, COASTING may move the vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import assert_never

from control.config import EngagementConfig
from control.preflight import Cause, Inputs, link_ok, refusals, target_seen, telemetry_ok, video_ok
from control.types import VehicleMode

__all__ = ["Action", "Cause", "Engagement", "Inputs", "Output", "State"]


class State(Enum):
    """What the operator sees."""

    NO_VIDEO = "no video"
    IDLE = "idle"
    SELECTED = "selected"
    FOLLOWING = "following"
    COASTING = "coasting"
    LOST_HOLD = "lost, holding"
    RELEASED = "released"
    TAKEN_OVER = "taken over"


class Action(Enum):
    """What the application does in this tick; each setpoint still goes through the gate."""

    NONE = "none"  # not engaged: nothing to do, nothing on the wire
    ENGAGE = "engage"  # send a priming zero and ask for external control, repeated at the adapter's pace
    SEND_REQUEST = "send request"  # the follow law's request, scaled by velocity_factor
    SEND_ZERO = "send zero"
    COMMAND_HOLD = "command hold"  # send zero and ask for the hold mode, repeated at the adapter's pace
    SILENCE = "silence"  # send nothing: the vehicle is somebody else's, or does not answer


@dataclass(frozen=True, slots=True)
class Output:
    """State after the tick, why, and what to do. velocity_factor: 1 following, 1 to 0 coasting, else 0."""

    state: State
    reasons: tuple[Cause, ...]
    action: Action
    velocity_factor: float = 0.0
    engaging: bool = False  # confirmed, waiting for the vehicle to take up external control


_HOLD_AT_LEAST_S = 0.5


class Engagement:
    """Holds the state between ticks. Following starts only from a confirm with no refusal."""

    def __init__(self, config: EngagementConfig | None = None) -> None:
        self._config = config or EngagementConfig()
        self._state = State.NO_VIDEO
        self._reasons: tuple[Cause, ...] = ()
        self._since_s = 0.0  # when this state began; while engaging, the confirmation
        self._seen_s = 0.0  # when the target was last measured to our liking
        self._engaging = False
        self._holding = False  # released, and the hold mode not yet seen
        self._last_tick_s: float | None = None

    def update(self, now_s: float, inputs: Inputs) -> Output:
        """Judge one tick. reasons: the refusals of a confirm, or why following stopped or slows."""
        gap_s = 0.0 if self._last_tick_s is None else now_s - self._last_tick_s
        self._last_tick_s = now_s
        match self._state:
            case State.FOLLOWING | State.COASTING | State.LOST_HOLD:
                return self._engaged(now_s, inputs, gap_s)
            case State.NO_VIDEO | State.IDLE | State.SELECTED:
                return self._engaged(now_s, inputs, gap_s) if self._engaging else self._waiting(now_s, inputs)
            case State.RELEASED | State.TAKEN_OVER:
                return self._ended(now_s, inputs)
            case _:  # pragma: no cover - the type checker proves it
                assert_never(self._state)

    def _waiting(self, now_s: float, inputs: Inputs) -> Output:
        resting = self._resting(now_s, inputs)
        if resting is not self._state or inputs.select:
            self._go(resting, now_s)
        if inputs.abort:
            if inputs.vehicle.mode is VehicleMode.EXTERNAL:
                return self._release(now_s, inputs, Cause.ABORT)
        elif inputs.confirm:
            self._reasons = refusals(inputs, now_s, self._config)
            if not self._reasons:
                self._engaging, self._since_s, self._seen_s = True, now_s, now_s
                return self._engaged(now_s, inputs, 0.0)
        return Output(self._state, self._reasons, Action.NONE)

    def _engaged(self, now_s: float, inputs: Inputs, gap_s: float) -> Output:
        mode = inputs.vehicle.mode
        if inputs.abort and mode in (VehicleMode.EXTERNAL, VehicleMode.HOLD):
            return self._release(now_s, inputs, Cause.ABORT)
        taken = self._taken_over(inputs)
        if taken is not None:
            self._go(State.TAKEN_OVER, now_s, taken)
            return Output(self._state, self._reasons, Action.SILENCE)
        cause = self._why_release(now_s, inputs, gap_s)
        if cause is not None:
            return self._release(now_s, inputs, cause)
        if not self._engaging:
            return self._follow(now_s, inputs)
        if mode is VehicleMode.EXTERNAL:
            self._go(State.FOLLOWING, now_s)
            return self._follow(now_s, inputs)
        if now_s - self._since_s > self._config.engage_s:
            return self._release(now_s, inputs, Cause.MODE_REFUSED)
        return Output(self._state, (), Action.ENGAGE, engaging=True)

    def _taken_over(self, inputs: Inputs) -> Cause | None:
        mode = inputs.vehicle.mode
        if inputs.vehicle.failsafe:
            return Cause.FAILSAFE
        if mode is not VehicleMode.EXTERNAL and not (self._engaging and mode is VehicleMode.HOLD):
            return Cause.MODE_CHANGED
        return None if inputs.vehicle.armed else Cause.NOT_ARMED

    def _why_release(self, now_s: float, inputs: Inputs, gap_s: float) -> Cause | None:
        config, asked_s = self._config, inputs.request_t_s
        silent_s = now_s - (self._since_s if asked_s is None else max(asked_s, self._since_s))
        checks = (
            (Cause.OWN_GAP, 0 <= gap_s <= config.request_age_s),
            (Cause.LINK_LOST, link_ok(inputs, now_s, config)),
            (Cause.TELEMETRY_STALE, telemetry_ok(inputs, now_s, config)),
            (Cause.OUTSIDE_FENCE, not inputs.outside_fence),
            (Cause.STALLED, self._state is not State.FOLLOWING or silent_s <= config.stall_s),
        )
        return next((cause for cause, fine in checks if not fine), None)

    def _follow(self, now_s: float, inputs: Inputs) -> Output:
        config = self._config
        if target_seen(inputs, now_s, config):
            self._seen_s = max(self._seen_s, inputs.measured_t_s or self._seen_s)
            self._become(State.FOLLOWING, now_s)
            return Output(self._state, (), Action.SEND_REQUEST, 1.0)
        unseen_s = now_s - self._seen_s
        if unseen_s > config.release_s:
            return self._release(now_s, inputs, Cause.TARGET_LOST)
        if unseen_s >= config.lost_s:
            self._become(State.LOST_HOLD, now_s)
            return Output(self._state, (Cause.TARGET_UNSEEN,), Action.SEND_ZERO)
        self._become(State.COASTING, now_s)
        factor = min((config.lost_s - unseen_s) / (config.lost_s - config.target_age_s), 1.0)
        return Output(self._state, (Cause.TARGET_UNSEEN,), Action.SEND_REQUEST, factor)

    def _release(self, now_s: float, inputs: Inputs, cause: Cause) -> Output:
        self._go(State.RELEASED, now_s, cause)
        self._holding = True
        return self._hold(now_s, inputs)

    def _hold(self, now_s: float, inputs: Inputs) -> Output:
        """Ask for hold until it is seen, and a moment longer: our own mode request may still be under way."""
        mode, age_s = inputs.vehicle.mode, now_s - self._since_s
        if mode is VehicleMode.EXTERNAL:
            if age_s > self._config.hold_s:
                self._holding = False
                self._reasons = (*self._reasons, Cause.HOLD_REFUSED)
        elif mode is not VehicleMode.HOLD or age_s > _HOLD_AT_LEAST_S:
            self._holding = False
        action = Action.COMMAND_HOLD if self._holding else Action.SILENCE
        return Output(self._state, self._reasons, action)

    def _ended(self, now_s: float, inputs: Inputs) -> Output:
        if inputs.abort and inputs.vehicle.mode is VehicleMode.EXTERNAL:
            return self._release(now_s, inputs, Cause.ABORT)
        if self._holding:
            return self._hold(now_s, inputs)
        if inputs.acknowledge or (inputs.select and self._state is State.RELEASED):
            self._go(self._resting(now_s, inputs), now_s)
            return Output(self._state, (), Action.NONE)
        if inputs.confirm:
            self._reasons = (Cause.ACKNOWLEDGE, *refusals(inputs, now_s, self._config))
        return Output(self._state, self._reasons, Action.SILENCE)

    def _resting(self, now_s: float, inputs: Inputs) -> State:
        if not video_ok(inputs, now_s, self._config):
            return State.NO_VIDEO
        return State.SELECTED if inputs.selected else State.IDLE

    def _become(self, state: State, now_s: float) -> None:
        if state is not self._state:
            self._go(state, now_s)

    def _go(self, state: State, now_s: float, *reasons: Cause) -> None:
        self._state, self._since_s, self._reasons, self._engaging = state, now_s, reasons, False

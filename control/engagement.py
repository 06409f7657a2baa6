"""The follow state machine: when the vehicle may be moved. Pure; one call of update per 20 Hz tick.

Each tick gathers the causes that are active, and the worst decides (`control.causes` is the table). Only
FOLLOWING and, fading to zero, COASTING may move the vehicle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Final

from control.causes import Cause, Clear, Severity, leading, worst
from control.checks import fresh
from control.config import EngagementConfig
from control.preflight import Inputs, conditions, target_seen, video_ok
from control.types import VehicleMode

__all__ = ["MODE_AGE_S", "Action", "Cause", "Engagement", "Inputs", "Output", "State"]


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
    warnings: tuple[Cause, ...] = ()  # to be told; they change nothing
    settling: bool = False  # released, and hold not seen yet: nothing new can begin


_REACTIONS: Final[Mapping[Severity, tuple[State, Action]]] = {
    Severity.NONE: (State.FOLLOWING, Action.SEND_REQUEST),
    Severity.WARN: (State.FOLLOWING, Action.SEND_REQUEST),
    Severity.COAST: (State.COASTING, Action.SEND_REQUEST),
    Severity.ZERO: (State.LOST_HOLD, Action.SEND_ZERO),
    Severity.RELEASE: (State.RELEASED, Action.COMMAND_HOLD),
    Severity.SILENT: (State.RELEASED, Action.SILENCE),
    Severity.TAKEN_OVER: (State.TAKEN_OVER, Action.SILENCE),
    Severity.ABORT: (State.RELEASED, Action.COMMAND_HOLD),
}
_ENGAGED: Final = (State.FOLLOWING, State.COASTING, State.LOST_HOLD)
_ENDED: Final = (State.RELEASED, State.TAKEN_OVER)
_SETTLE_S: Final = 0.5  # hold is commanded at least so long: our own mode request may still be under way
MODE_AGE_S: Final = 1.0  # older, the vehicle may long be holding, or be a pilot's; it is asked for five times a second
_LISTEN_S: Final = 0.1  # after a gap of our own what had waited is read by then: only what is newer counts
_RECOVERY: Final = 0.25  # as in PX4: a flickering condition still ends in its action


class Engagement:
    """Holds the state between ticks. Following starts only from a confirm with no refusal."""

    def __init__(self, config: EngagementConfig | None = None) -> None:
        self._config = config or EngagementConfig()
        self._state = State.NO_VIDEO
        self._reasons: tuple[Cause, ...] = ()  # shown: why it ended, or why a confirm was refused
        self._ended_by: tuple[Cause, ...] = ()
        self._since_s = 0.0  # when this state began; while engaging, the confirmation
        self._seen_s = 0.0  # when the target was last measured to our liking
        self._unseen_debt_s = 0.0  # time without the target that has not been made up for
        self._engaging = False
        self._holding = False  # released, and the hold mode not yet seen
        self._last_tick_s: float | None = None

    def update(self, now_s: float, inputs: Inputs) -> Output:
        """Judge one tick. reasons: the refusals of a confirm, or why following stopped or slows."""
        gap_s = 0.0 if self._last_tick_s is None else now_s - self._last_tick_s
        self._last_tick_s = now_s
        active = conditions(inputs, now_s, self._config)
        if self._engaging or self._state in _ENGAGED:
            output = self._engaged(now_s, inputs, active, gap_s)
        elif self._state in _ENDED:
            output = self._ended(now_s, inputs, active)
        else:
            output = self._waiting(now_s, inputs, active)
        return replace(output, warnings=tuple(cause for cause in active if cause.severity is Severity.WARN))

    def _waiting(self, now_s: float, inputs: Inputs, active: tuple[Cause, ...]) -> Output:
        resting = self._resting(now_s, inputs)
        if resting is not self._state or inputs.select:
            self._go(resting, now_s)
        if inputs.abort:
            if inputs.vehicle.mode is VehicleMode.EXTERNAL:
                return self._end(now_s, inputs, (Cause.ABORT,))
        elif inputs.confirm:
            self._reasons = tuple(cause for cause in active if cause.refuses)
            if not self._reasons:
                self._engaging, self._since_s, self._seen_s, self._unseen_debt_s = True, now_s, now_s, 0.0
                return self._engaged(now_s, inputs, active, 0.0)
        return Output(self._state, self._reasons, Action.NONE)

    def _engaged(self, now_s: float, inputs: Inputs, active: tuple[Cause, ...], gap_s: float) -> Output:
        causes = (*active, *self._own_causes(now_s, inputs, gap_s))
        if self._engaging and inputs.vehicle.mode is not VehicleMode.EXTERNAL and worst(causes) < Severity.RELEASE:
            return Output(self._state, (), Action.ENGAGE, engaging=True)
        causes = (*causes, *self._target_causes(now_s, inputs, gap_s))
        severity = worst(causes)
        if severity >= Severity.RELEASE:
            return self._end(now_s, inputs, leading(causes))
        state, action = _REACTIONS[severity]
        if state is not self._state:
            self._go(state, now_s)
        if severity < Severity.COAST:
            return Output(state, (), action, 1.0)
        config, unseen_s = self._config, now_s - self._seen_s
        factor = (config.lost_s - unseen_s) / (config.lost_s - config.target_age_s)
        return Output(state, leading(causes), action, min(max(factor, 0.0), 1.0))

    def _own_causes(self, now_s: float, inputs: Inputs, gap_s: float) -> tuple[Cause, ...]:
        """What ends a follow and needs memory, or the operator's order."""
        config, mode, asked_s = self._config, inputs.vehicle.mode, inputs.request_t_s
        silent_s = now_s - (self._since_s if asked_s is None else max(asked_s, self._since_s))
        awaited = self._engaging and mode is VehicleMode.HOLD
        checks = (
            (Cause.OWN_GAP, 0 <= gap_s <= config.request_age_s),
            (Cause.STALLED, self._state is not State.FOLLOWING or silent_s <= config.stall_s),
            (Cause.MODE_REFUSED, not awaited or now_s - self._since_s <= config.engage_s),
            (Cause.MODE_CHANGED, mode is VehicleMode.EXTERNAL or awaited),
            (Cause.ABORT, not (inputs.abort and mode in (VehicleMode.EXTERNAL, VehicleMode.HOLD))),
        )
        return tuple(cause for cause, fine in checks if not fine)

    def _target_causes(self, now_s: float, inputs: Inputs, gap_s: float) -> tuple[Cause, ...]:
        """How long the target is unseen; in a row, or in pieces that being seen has not made up for."""
        config, measured_t_s = self._config, inputs.measured_t_s
        if measured_t_s is not None and target_seen(inputs, now_s, config):
            self._seen_s = max(self._seen_s, measured_t_s)
            self._unseen_debt_s = max(self._unseen_debt_s - _RECOVERY * gap_s, 0.0)
            return ()
        self._unseen_debt_s += gap_s
        if max(now_s - self._seen_s, self._unseen_debt_s) > config.release_s:
            return (Cause.TARGET_LOST,)
        return (Cause.TARGET_AWAY if now_s - self._seen_s >= config.lost_s else Cause.TARGET_UNSEEN,)

    def _end(self, now_s: float, inputs: Inputs, causes: tuple[Cause, ...]) -> Output:
        state, action = _REACTIONS[worst(causes)]
        self._go(state, now_s, *causes)
        self._ended_by, self._holding = causes, action is Action.COMMAND_HOLD
        return self._hold(now_s, inputs)

    def _hold(self, now_s: float, inputs: Inputs) -> Output:
        """Ask for hold until it is seen, and a moment longer; only once where the mode is not heard."""
        mode, age_s = inputs.vehicle.mode, now_s - self._since_s
        old_news = Cause.OWN_GAP in self._ended_by and not fresh(inputs.vehicle.mode_t_s, now_s, age_s - _LISTEN_S)
        unheard = age_s > 0 and not fresh(inputs.vehicle.mode_t_s, now_s, MODE_AGE_S)
        if self._holding and mode is VehicleMode.EXTERNAL and age_s > self._config.hold_s:
            self._ended_by = self._reasons = (*self._ended_by, Cause.HOLD_REFUSED)
            self._holding = False
        elif unheard or (mode is not VehicleMode.EXTERNAL and (mode is not VehicleMode.HOLD or age_s > _SETTLE_S)):
            self._holding = False
        action = Action.COMMAND_HOLD if self._holding and not old_news else Action.SILENCE
        return Output(self._state, self._reasons, action, settling=self._holding)

    def _ended(self, now_s: float, inputs: Inputs, active: tuple[Cause, ...]) -> Output:
        if inputs.abort and inputs.vehicle.mode is VehicleMode.EXTERNAL:
            return self._end(now_s, inputs, (Cause.ABORT,))
        if self._holding:
            return self._hold(now_s, inputs)
        by_selection = all(cause.clear is Clear.BY_SELECTION for cause in self._ended_by)
        if inputs.acknowledge or (inputs.select and by_selection):
            self._go(self._resting(now_s, inputs), now_s)
            return Output(self._state, (), Action.NONE)
        if inputs.confirm:
            self._reasons = (Cause.ACKNOWLEDGE, *(cause for cause in active if cause.refuses))
        return Output(self._state, self._reasons, Action.SILENCE)

    def _resting(self, now_s: float, inputs: Inputs) -> State:
        if not video_ok(inputs, now_s, self._config):
            return State.NO_VIDEO
        return State.SELECTED if inputs.selected else State.IDLE

    def _go(self, state: State, now_s: float, *reasons: Cause) -> None:
        self._state, self._since_s, self._reasons, self._engaging = state, now_s, reasons, False

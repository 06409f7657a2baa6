"""What one 20 Hz decision is made of: the operator's acts in, a setpoint and the reasons out."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from control.engagement import Inputs, Output
from control.gate import Setpoint
from control.gimbal import GimbalRequest, GimbalState
from control.modes import Confirmation, FollowMode
from control.motion import TargetMotion
from control.types import Reason, TargetState, VelocityRequest
from gcs.latency_budget import Budget


class Act(Enum):
    """What the operator did since the last tick."""

    SELECT = "select"
    CONFIRM = "confirm"
    ABORT = "abort"
    ACKNOWLEDGE = "acknowledge"


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a confirmation asks for; None: the distance of that moment, told by height and view angle."""

    mode: FollowMode = FollowMode.FOLLOW
    standoff_m: float | None = None
    distance_m: float | None = None


@dataclass(frozen=True, slots=True)
class Tick:
    """One 20 Hz decision, complete: what a replay must reproduce."""

    t_s: float
    inputs: Inputs
    output: Output
    target: TargetState | None
    request: VelocityRequest | None
    setpoint: Setpoint | None
    gate: Reason
    camera: GimbalState | None = None  # where it looks, if it is on a gimbal and that is known
    gimbal: GimbalRequest | None = None  # None: there is none, or nobody is followed
    budget: Budget | None = None  # of the newest picture, in the first tick that knows of it
    motion: TargetMotion | None = None  # of the target, as the follow law believes it
    held: Confirmation | None = None  # what is being held; None: nobody is followed
    wanted: Wanted = Wanted()  # what the next confirmation asks for
    changed: Confirmation | None = None  # by the operator since the last tick: what is to be held instead

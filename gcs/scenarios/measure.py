"""What a flight was worth: the columns of the table, from the truth and from the judge on the wire."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from control.engagement import State
from control.modes import FollowMode
from control.types import Vec3
from gcs.lockstep.world import World
from gcs.truth import Standing

if TYPE_CHECKING:
    from gcs.scenarios.catalogue import Scenario
    from gcs.scenarios.conditions import Conditions

_CLOSING_MPS: Final = 0.3  # less is a drift
_ENGAGED: Final = (State.FOLLOWING, State.COASTING, State.LOST_HOLD)


@dataclass(frozen=True, slots=True)
class Sample(Standing):
    """The truth at one moment after the confirmation, and what was commanded. NED metres, m/s, rad.

    is_visible, is_hit: of the newest picture, whether it showed the target and whether the tracker's box was on it.
    """

    t_s: float
    stage_t_s: float
    vehicle_ned_m: Vec3
    yaw_rad: float
    target_ned_m: Vec3
    state: State
    is_visible: bool
    is_hit: bool
    velocity_ned_mps: Vec3
    yaw_rate_rps: float
    own_velocity_ned_mps: Vec3 = (0.0, 0.0, 0.0)  # flown by itself: without the gusts that push it


@dataclass(frozen=True, slots=True)
class Row:
    """The columns. None: not a thing of this scenario. reacquire_s: infinite where it never did.

    bearing and distance: rms, after settling, while the vehicle was ours and the target not hidden; distance in parts
    of the true one at the confirmation. on_target_frac: of the time in which the target was not hidden. approached_m:
    the nearest at which the vehicle, while it was ours, itself flew towards the target; gusts that push it are not it.
    """

    bearing_rms_deg: float
    distance_rms_frac: float | None
    smallest_distance_m: float
    on_target_frac: float
    reacquire_s: float | None
    max_gap_s: float
    unsafe: int
    state: State
    digest: int
    refusal: str = ""
    reasons: tuple[str, ...] = ()  # of unsafe events
    approached_m: float = math.inf
    causes: tuple[str, ...] = ()  # why the follow had ended before the scenario did


def measure(
    scenario: Scenario, conditions: Conditions, samples: Sequence[Sample], world: World, refusal: str = ""
) -> Row:
    """The row of one flight."""
    summary = world.monitor.summary()
    reasons = tuple(f"{r['rule']} at {r['t_s']:.2f} s: {r['text']}" for r in summary["reasons"])
    if refusal or not samples:
        unsafe, digest = int(summary["unsafe"]), world.exit.digest
        return Row(math.inf, None, math.inf, 0.0, None, math.inf, unsafe, State.IDLE, digest, refusal, reasons)
    shown = [s for s in samples if not _is_unseen(scenario, s.stage_t_s)]
    settled = [s for s in shown if s.t_s >= scenario.settle_s and s.state in _ENGAGED]
    standoff_m = samples[0].distance_m
    holds = (conditions.mode or scenario.mode) is not FollowMode.SPOTLIGHT
    return Row(
        _rms([math.degrees(s.bearing_error_rad) for s in settled]),
        _rms([s.distance_m / standoff_m - 1.0 for s in settled]) if holds else None,
        min(s.distance_m for s in samples),
        sum(s.is_hit and s.state in _ENGAGED for s in shown) / len(shown),
        _reacquired_s(scenario, samples),
        float(summary["max_setpoint_gap_s"]),
        int(summary["unsafe"]),
        samples[-1].state,
        world.exit.digest,
        reasons=reasons,
        approached_m=_approached_m(samples),
        causes=_causes(world),
    )


def _approached_m(samples: Sequence[Sample]) -> float:
    nearest_m = math.inf
    for now in samples:
        towards = [now.target_ned_m[i] - now.vehicle_ned_m[i] for i in (0, 1)]
        own = zip(towards, now.own_velocity_ned_mps, strict=False)
        closing_mps = sum(a * b for a, b in own) / max(now.distance_m, 1e-9)
        if now.state in _ENGAGED and closing_mps > _CLOSING_MPS:
            nearest_m = min(nearest_m, now.distance_m)
    return nearest_m


def _causes(world: World) -> tuple[str, ...]:
    tick = world.flight.tick
    if tick is None or tick.output.state in _ENGAGED:
        return ()
    return tuple(cause.value for cause in tick.output.reasons)


def _is_unseen(scenario: Scenario, t_s: float) -> bool:
    return any(start_s <= t_s < end_s for start_s, end_s in scenario.unseen)


def _reacquired_s(scenario: Scenario, samples: Sequence[Sample]) -> float | None:
    """The longest it took to follow again once the target was there again."""
    if not scenario.unseen:
        return None
    longest_s = 0.0
    for _, end_s in scenario.unseen:
        again = (s.stage_t_s for s in samples if s.stage_t_s >= end_s and s.is_hit and s.state is State.FOLLOWING)
        longest_s = max(longest_s, next(again, math.inf) - end_s)
    return longest_s


def _rms(values: Sequence[float]) -> float:
    return math.sqrt(math.fsum(v * v for v in values) / len(values)) if values else math.inf

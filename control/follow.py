"""From the predicted target and the vehicle's state to a shaped velocity request: one tick of following."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from control.camera import CameraModel
from control.config import ControlConfig, FollowConfig
from control.gimbal import GimbalState, hand_over_rps
from control.laws import Scene, velocity_wish
from control.limits import ShapeState, Wish, shape
from control.modes import Confirmation, sure_ground_m
from control.motion import Belief, TargetMotion, believe, target_motion
from control.types import TargetState, Vec3, VehicleState, VelocityRequest
from control.yaw import YawState, yaw_rate_rps


@dataclass(frozen=True, slots=True)
class FollowState:
    """What one tick hands to the next: shaping, and the vehicle's own velocity as late as the filter's rates."""

    shaping: ShapeState
    own_velocity_ned_mps: Vec3 | None = None
    belief: Belief | None = None
    motion: TargetMotion | None = None  # as believed in that tick
    yaw: YawState | None = None

    @classmethod
    def at_rest(cls, now_s: float) -> FollowState:
        """Where every follow begins, and where it begins again after any stop."""
        return cls(ShapeState(now_s))


def follow_request(
    confirmation: Confirmation,
    target: TargetState,
    vehicle: VehicleState,
    camera: CameraModel,
    now_s: float,
    state: FollowState,
    config: ControlConfig,
    *,
    velocity_factor: float = 1.0,
    coasting: bool = False,
    gimbal: GimbalState | None = None,
) -> tuple[VelocityRequest, FollowState]:
    """The request of this 20 Hz tick and the shaping state after it.

    target: the estimator's prediction for when the command arrives. velocity_factor: the state machine's
    (1 while following, falling to 0 while coasting). gimbal: the camera is on one, and how that stands.
    """
    follow = config.follow
    own = _lagged(state, vehicle.velocity_ned_mps, now_s, follow)
    ground_m = sure_ground_m(target, vehicle, follow) if confirmation.ground_factor is not None else None
    motion = target_motion(confirmation, target, own, follow, ground_m)
    trust = target.size_trust if ground_m is None else max(target.size_trust, target.elevation_trust)
    belief = believe(state.belief, motion, trust, now_s, follow)
    motion = replace(
        motion,
        radial_mps=belief.radial_mps,
        steady_radial_mps=belief.steady_mps,
        steady_tangential_mps=belief.steady_tangential_mps,
    )
    wish = velocity_wish(Scene(confirmation, target, vehicle, camera, follow, motion, own, coasting))
    if gimbal is not None:  # it keeps the target in view while the vehicle tilts
        wish = replace(wish, sight_acceleration_mps2=(-math.inf, math.inf))
    yaw = None
    if gimbal is not None and gimbal.ours and gimbal.limits.has_yaw:
        yaw_rps = hand_over_rps(target, gimbal, config.gimbal)
    else:
        last = state.shaping.t_s, state.shaping.yaw_rate_rps
        most_rps2 = config.shaping.yaw_acceleration_rps2
        yaw_rps, yaw = yaw_rate_rps(target, vehicle, camera, now_s, state.yaw, last, follow, most_rps2)
    wish = replace(wish, yaw_rate_rps=yaw_rps)
    if velocity_factor < 1.0:
        wish = _faded(wish, max(velocity_factor, 0.0))
    request, after, _ = shape(state.shaping, wish, now_s, config.shaping)
    return request, FollowState(after, own, belief, motion, yaw)


def _faded(wish: Wish, factor: float) -> Wish:
    """What is left of it while the target is not seen."""
    north, east, down = wish.velocity_ned_mps
    return replace(
        wish,
        velocity_ned_mps=(north * factor, east * factor, down * factor),
        yaw_rate_rps=wish.yaw_rate_rps * factor,
        brake=True,
        limited_by=(*wish.limited_by, "coasting"),
    )


def _lagged(state: FollowState, now_ned_mps: Vec3, now_s: float, config: FollowConfig) -> Vec3:
    """The own velocity, first-order lagged to match the filter's rates: their sum is the target's velocity.

    Unmatched, every change of our own speed would for a moment look like one of the target's.
    """
    before = state.own_velocity_ned_mps
    if before is None:
        return now_ned_mps
    dt_s = max(now_s - state.shaping.t_s, 0.0)
    k = 1 - math.exp(-dt_s / max(config.rate_lag_s, 1e-3))
    north, east, down = (a + k * (b - a) for a, b in zip(before, now_ned_mps, strict=True))
    return north, east, down

"""The follow laws: from the predicted target and the vehicle's state to a shaped velocity request.

Everything horizontal is resolved along the line of sight (radial, away from the vehicle is positive) and
across it (tangential, clockwise seen from above is positive).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import assert_never

from control.camera import CameraModel
from control.config import ControlConfig, FollowConfig
from control.limits import ShapeState, Wish, shape
from control.modes import Confirmation, FollowMode, sure_ground_m
from control.motion import Belief, TargetMotion, believe, target_motion
from control.types import TargetState, Vec3, VehicleState, VelocityRequest
from control.yaw import yaw_rate_rps

_GRAVITY_MPS2 = 9.81
_MAX_TILT_RAD = math.radians(80)


@dataclass(frozen=True, slots=True)
class FollowState:
    """What one tick hands to the next: shaping, and the vehicle's own velocity as late as the filter's rates."""

    shaping: ShapeState
    own_velocity_ned_mps: Vec3 | None = None
    belief: Belief | None = None

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
) -> tuple[VelocityRequest, FollowState]:
    """The request of this 20 Hz tick and the shaping state after it.

    target: the estimator's prediction for now + config.follow.lead_s. velocity_factor: the state machine's
    (1 while following, falling to 0 while coasting).
    """
    own = _lagged(state, vehicle.velocity_ned_mps, now_s, config.follow)
    ground_m = sure_ground_m(target, vehicle, config.follow)
    motion = target_motion(confirmation, target, own, config.follow, ground_m)
    trust = target.size_trust if ground_m is None else max(target.size_trust, target.elevation_trust)
    belief = believe(state.belief, motion, trust, now_s, config.follow)
    wish = follow_wish(confirmation, target, vehicle, camera, config.follow, own, belief, coasting=coasting)
    if velocity_factor < 1.0:
        factor = max(velocity_factor, 0.0)
        north, east, down = wish.velocity_ned_mps
        wish = Wish(
            (north * factor, east * factor, down * factor),
            wish.yaw_rate_rps * factor,
            brake=True,
            limited_by=(*wish.limited_by, "coasting"),
        )
    request, after, _ = shape(state.shaping, wish, now_s, config.shaping)
    return request, FollowState(after, own, belief)


def follow_wish(
    confirmation: Confirmation,
    target: TargetState,
    vehicle: VehicleState,
    camera: CameraModel,
    config: FollowConfig,
    own_velocity_ned_mps: Vec3,
    belief: Belief | None = None,
    *,
    coasting: bool = False,
) -> Wish:
    """What the confirmed mode would like, before shaping."""
    match confirmation.mode:
        case FollowMode.SPOTLIGHT:
            return spotlight(confirmation, target, vehicle, camera, config)
        case FollowMode.FOLLOW:
            return follow(
                confirmation, target, vehicle, camera, config, own_velocity_ned_mps, belief, coasting=coasting
            )
        case _:  # pragma: no cover - the type checker proves it
            assert_never(confirmation.mode)


def spotlight(
    confirmation: Confirmation,
    target: TargetState,
    vehicle: VehicleState,
    camera: CameraModel,
    config: FollowConfig,
) -> Wish:
    """Yaw to the target; hold the place of the confirmation (a zero velocity setpoint alone would drift)."""
    north, east = (
        config.station_gain_ps * (then - now)
        for then, now in zip(confirmation.position_ned_m[:2], vehicle.position_ned_m[:2], strict=True)
    )
    speed = math.hypot(north, east)
    scale = min(1.0, config.max_station_speed_mps / max(speed, 1e-9))
    down = _hold_height_mps(confirmation, vehicle, config)
    return Wish((north * scale, east * scale, down), yaw_rate_rps(target, vehicle, camera, config))


def follow(
    confirmation: Confirmation,
    target: TargetState,
    vehicle: VehicleState,
    camera: CameraModel,
    config: FollowConfig,
    own_velocity_ned_mps: Vec3,
    belief: Belief | None = None,
    *,
    coasting: bool = False,
) -> Wish:
    """Yaw to the target, hold distance and height, move along with it; never close in on a guess."""
    ground_m = sure_ground_m(target, vehicle, config)
    motion = target_motion(confirmation, target, own_velocity_ned_mps, config, ground_m)
    if belief is not None:
        motion = replace(motion, radial_mps=belief.radial_mps)
    error_m = motion.distance_m - confirmation.standoff_m
    radial = config.range_gain_ps * error_m + config.target_velocity_gain * motion.radial_mps
    tangential = config.target_velocity_gain * motion.tangential_mps
    radial, names, brake = _limit_closing(radial, motion, target, config, coasting)
    trust = confidence_factor(target.confidence, config)
    if trust < 1.0:
        radial, tangential = radial * trust, tangential * trust
        names = (*names, "confidence")
    speed = math.hypot(radial, tangential)
    if speed > config.max_speed_mps:
        radial, tangential = (v * config.max_speed_mps / speed for v in (radial, tangential))
        names = (*names, "speed")
    north, east = math.cos(target.azimuth_rad), math.sin(target.azimuth_rad)
    velocity: Vec3 = (
        radial * north - tangential * east,
        radial * east + tangential * north,
        _hold_height_mps(confirmation, vehicle, config),
    )
    return Wish(
        velocity,
        yaw_rate_rps(target, vehicle, camera, config),
        brake,
        (north, east),
        view_acceleration_mps2(target.elevation_rad, camera, config),
        names,
    )


def stoppable_speed_mps(margin_m: float, config: FollowConfig) -> float:
    """The largest v with v <= margin / (response + v / a): what can still be stopped short of the margin."""
    if margin_m <= 0:
        return 0.0
    a, t = config.braking_mps2, config.response_s
    return a / 2 * (math.sqrt(t * t + 4 * margin_m / a) - t)


def view_acceleration_mps2(elevation_rad: float, camera: CameraModel, config: FollowConfig) -> tuple[float, float]:
    """Bounds (low, high) of the acceleration towards the target whose pitch keeps it in a fixed camera's view.

    Accelerating forward by a pitches the nose down by atan(a / g), which moves the target up in the picture.
    """
    half_rad = camera.vfov_rad * (0.5 - config.view_margin_frac)
    off_axis_rad = elevation_rad - camera.mount_rpy_rad[1]
    up_rad = min(max(half_rad - off_axis_rad, -_MAX_TILT_RAD), _MAX_TILT_RAD)
    down_rad = min(max(half_rad + off_axis_rad, -_MAX_TILT_RAD), _MAX_TILT_RAD)
    least = config.min_acceleration_mps2
    high = max(_GRAVITY_MPS2 * math.tan(up_rad), least)
    return min(-_GRAVITY_MPS2 * math.tan(down_rad), -least), high


def confidence_factor(confidence: float, config: FollowConfig) -> float:
    """1 from full_confidence on, falling to 0 at half of closing_confidence: a weak score slows, smoothly."""
    low = config.closing_confidence / 2
    if confidence >= config.full_confidence:
        return 1.0
    return max(0.0, (confidence - low) / (config.full_confidence - low))


def _limit_closing(
    radial: float, motion: TargetMotion, target: TargetState, config: FollowConfig, coasting: bool
) -> tuple[float, tuple[str, ...], bool]:
    """Bound the speed towards the target: by stopping distance, time to collision, coasting, confidence."""
    caps = {"stopping distance": stoppable_speed_mps(motion.nearest_m - config.min_distance_m, config)}
    sure_rate_ps = target.log_size_rate_ps - target.log_size_rate_std_ps
    collision = sure_rate_ps * config.time_to_collision_s > 1.0
    if collision:
        caps["time to collision"] = 0.0
    if coasting:  # it may still be moving on: keep up with it as the velocity fades, never close in, never speed up
        caps["coasting"] = max(min(motion.radial_mps, motion.own_radial_mps), 0.0)
    if target.confidence < config.closing_confidence:
        caps["closing confidence"] = 0.0
    names = tuple(name for name, cap in caps.items() if radial > cap)
    limited = min(radial, *caps.values())
    return limited, names, collision or motion.own_radial_mps > caps["stopping distance"] + 0.5


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


def _hold_height_mps(confirmation: Confirmation, vehicle: VehicleState, config: FollowConfig) -> float:
    down = config.height_gain_ps * (vehicle.height_m - confirmation.height_m)
    return min(max(down, -config.max_vertical_mps), config.max_vertical_mps)

"""The modes, each as a velocity it would like: pure geometry, shaped and gated elsewhere.

Everything horizontal is resolved along the line of sight (radial, away from the vehicle is positive) and across it
(tangential, as the target moves clockwise around the vehicle, seen from above). Distance comes first: what is across
gets what max_speed_mps leaves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import assert_never

from control.attitude import wrap_pi
from control.camera import CameraModel
from control.closing import confidence_factor, limit_closing, stoppable_speed_mps
from control.config import FollowConfig
from control.field_of_view import view_acceleration_mps2
from control.height import vertical_mps
from control.limits import Wish
from control.modes import Confirmation, FollowMode
from control.motion import TargetMotion
from control.types import TargetState, Vec3, VehicleState


@dataclass(frozen=True, slots=True)
class Scene:
    """All that a law looks at. own_velocity_ned_mps: as late as the filter's rates."""

    confirmation: Confirmation
    target: TargetState
    vehicle: VehicleState
    camera: CameraModel
    config: FollowConfig
    motion: TargetMotion
    own_velocity_ned_mps: Vec3
    coasting: bool = False


def velocity_wish(scene: Scene) -> Wish:
    """What the confirmed mode would like, its yaw rate left at zero: that is the same in all of them."""
    match scene.confirmation.mode:
        case FollowMode.SPOTLIGHT:
            return _spotlight(scene)
        case FollowMode.FOLLOW:
            return _hold_distance(scene, scene.config.sideways_gain * scene.motion.tangential_mps)
        case FollowMode.PARALLEL:
            return _hold_distance(scene, _alongside_mps(scene) + _bearing_correction_mps(scene))
        case FollowMode.ORBIT:
            return _hold_distance(scene, _alongside_mps(scene) - _orbit_speed_mps(scene))
        case _:  # pragma: no cover - the type checker proves it
            assert_never(scene.confirmation.mode)


def circle_speed_mps(radius_m: float, config: FollowConfig) -> float:
    """The most that a circle of this radius allows: of centripetal acceleration v² / r, and of yaw rate v / r."""
    radius_m = max(radius_m, 0.0)
    return min(
        math.sqrt(config.orbit_acceleration_mps2 * radius_m),
        config.orbit_yaw_frac * config.max_yaw_rate_rps * radius_m,
        config.max_speed_mps,
    )


def _spotlight(scene: Scene) -> Wish:
    """Hold the place of the confirmation: a zero velocity setpoint alone would drift."""
    config = scene.config
    north, east = (
        config.station_gain_ps * (then - now)
        for then, now in zip(scene.confirmation.position_ned_m[:2], scene.vehicle.position_ned_m[:2], strict=True)
    )
    speed = math.hypot(north, east)
    scale = min(1.0, config.max_station_speed_mps / max(speed, 1e-9))
    return Wish((north * scale, east * scale, _vertical_mps(scene)), 0.0)


def _hold_distance(scene: Scene, tangential_mps: float) -> Wish:
    """Hold the standoff, never close in on a guess, and move across as the mode says."""
    config, target, motion, confirmation = scene.config, scene.target, scene.motion, scene.confirmation
    wanted = config.range_gain_ps * (motion.distance_m - confirmation.standoff_m)
    wanted += config.target_velocity_gain * motion.steady_radial_mps - confirmation.standoff_rate_mps(config)
    closing = limit_closing(wanted, motion, target, scene.vehicle, config, scene.coasting)
    radial, names = closing.radial_mps, closing.names
    # What is across now is towards the target as soon as that moves on.
    most = stoppable_speed_mps(motion.nearest_m - config.min_distance_m, target, scene.vehicle, config)
    tangential_mps = min(max(tangential_mps, -most), most)
    trust = confidence_factor(target.confidence, config)
    if trust < 1.0:
        radial, tangential_mps = radial * trust, tangential_mps * trust
        names = (*names, "confidence")
    if math.hypot(radial, tangential_mps) > config.max_speed_mps:
        radial = min(max(radial, -config.max_speed_mps), config.max_speed_mps)
        most = math.sqrt(max(config.max_speed_mps**2 - radial**2, 0.0))
        tangential_mps = min(max(tangential_mps, -most), most)
        names = (*names, "speed")
    north, east = math.cos(target.azimuth_rad), math.sin(target.azimuth_rad)
    velocity: Vec3 = (
        radial * north - tangential_mps * east,
        radial * east + tangential_mps * north,
        _vertical_mps(scene),
    )
    view = view_acceleration_mps2(target.elevation_rad, scene.camera, config)
    return Wish(velocity, 0.0, closing.brake, (north, east), view, names)


def _alongside_mps(scene: Scene) -> float:
    return scene.config.target_velocity_gain * scene.motion.steady_tangential_mps


def _bearing_correction_mps(scene: Scene) -> float:
    """Back to the bearing of the confirmation, the short way round and no faster than a circle may be flown."""
    error_rad = wrap_pi(scene.target.azimuth_rad - scene.confirmation.azimuth_rad)
    most = circle_speed_mps(scene.motion.distance_m, scene.config) * _room(scene)
    return min(max(scene.config.range_gain_ps * scene.motion.distance_m * error_rad, -most), most)


def _orbit_speed_mps(scene: Scene) -> float:
    """Around the target, clockwise seen from above positive."""
    config = scene.config
    most = min(abs(config.orbit_speed_mps), circle_speed_mps(scene.motion.distance_m, config)) * _room(scene)
    return math.copysign(most, config.orbit_speed_mps)


def _room(scene: Scene) -> float:
    """0 at the smallest distance, 1 from a fifth above: no circling where backing off is what matters, nor blindly."""
    if scene.coasting:
        return 0.0
    least_m = scene.config.min_distance_m
    return min(max((scene.motion.nearest_m - least_m) / (0.2 * least_m), 0.0), 1.0)


def _vertical_mps(scene: Scene) -> float:
    sure = not scene.coasting and scene.target.size_trust >= 0.5 and scene.target.elevation_trust >= 0.5
    sure = sure and scene.target.confidence >= scene.config.closing_confidence
    return vertical_mps(
        scene.confirmation, scene.target, scene.vehicle, scene.own_velocity_ned_mps, scene.config, sure=sure
    )

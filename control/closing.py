"""How fast the distance may shrink: stopping distance, time to collision, coasting, a weak score. For every mode."""

from __future__ import annotations

import math
from dataclasses import dataclass

from control.config import FollowConfig
from control.motion import TargetMotion
from control.types import TargetState, VehicleState


@dataclass(frozen=True, slots=True)
class Closing:
    """The radial velocity that is left (m/s), the names of what clips it, and whether to brake hard."""

    radial_mps: float
    names: tuple[str, ...]
    brake: bool


def stoppable_speed_mps(margin_m: float, target: TargetState, vehicle: VehicleState, config: FollowConfig) -> float:
    """The largest v with v <= margin / (response + v / a): what can still be stopped short of the margin.

    The response is the vehicle's, and by so much as the target was seen before the command acts, ours.
    """
    if margin_m <= 0:
        return 0.0
    a = min(config.braking_mps2, vehicle.braking_mps2)
    t = config.response_s + vehicle.late_s + max(target.t_s - target.measured_t_s, 0.0)
    return a / 2 * (math.sqrt(t * t + 4 * margin_m / a) - t)


def confidence_factor(confidence: float, config: FollowConfig) -> float:
    """1 from full_confidence on, falling to 0 at half of closing_confidence: a weak score slows, smoothly."""
    low = config.closing_confidence / 2
    if confidence >= config.full_confidence:
        return 1.0
    return max(0.0, (confidence - low) / (config.full_confidence - low))


def limit_closing(
    radial_mps: float,
    motion: TargetMotion,
    target: TargetState,
    vehicle: VehicleState,
    config: FollowConfig,
    coasting: bool,
) -> Closing:
    """Bound the speed towards the target; backing off is never bounded.

    Of a target that comes nearer the speed is taken off what can be stopped: near enough, the vehicle backs off.
    """
    stoppable_mps = stoppable_speed_mps(motion.nearest_m - config.min_distance_m, target, vehicle, config)
    caps = {"stopping distance": stoppable_mps + min(motion.radial_mps, motion.coming_mps, 0.0)}
    sure_rate_ps = target.log_size_rate_ps - target.log_size_rate_std_ps
    collision = sure_rate_ps * config.time_to_collision_s > 1.0
    if collision:
        caps["time to collision"] = 0.0
    if coasting:  # it may still be moving on: keep up with it as the velocity fades, never close in, never speed up
        caps["coasting"] = max(min(motion.radial_mps, motion.own_radial_mps), 0.0)
    if target.confidence < config.closing_confidence:
        caps["closing confidence"] = 0.0
    names = tuple(name for name, cap in caps.items() if radial_mps > cap)
    brake = collision or motion.own_radial_mps > caps["stopping distance"] + 0.5
    return Closing(min(radial_mps, *caps.values()), names, brake)

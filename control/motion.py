"""How a target moves over ground, from its filtered line of sight, and how much of that to believe."""

from __future__ import annotations

import math
from dataclasses import dataclass

from control.config import FollowConfig
from control.modes import Confirmation
from control.types import TargetState, Vec3

_MOST_SINCE = 0.5  # ln of the distance then over that of now


@dataclass(frozen=True, slots=True)
class TargetMotion:
    """The target seen from the vehicle, horizontally; velocities over ground, already faded by their spread.

    nearest_m: the least that size, as confirmed or as led by now, or height and depression say of the distance.
    sure_radial_mps: the largest radial velocity that one of the two tells. steady_*: what is worth going along with.
    coming_mps: the radial velocity made ready for the worst: as of now, not as late as the filter.
    """

    distance_m: float
    nearest_m: float
    radial_mps: float
    sure_radial_mps: float
    tangential_mps: float
    own_radial_mps: float
    own_tangential_mps: float
    steady_radial_mps: float
    steady_tangential_mps: float
    coming_mps: float


@dataclass(frozen=True, slots=True)
class Belief:
    """The target's radial velocity as believed at t_s, and for how long (s) nothing whole was seen of it.

    steady_mps: the same smoothed. A vehicle that answers a second late and gains 2.5 m/s each second only makes the
    distance worse by going along with what turns round every few seconds.
    """

    t_s: float
    radial_mps: float
    steady_mps: float
    steady_tangential_mps: float
    blind_s: float = 0.0


def range_m(confirmation: Confirmation, target: TargetState) -> float:
    """Slant range from how the apparent size has changed: d = d* exp(s* - s)."""
    return confirmation.range_m * math.exp(min(max(confirmation.log_size - target.log_size, -5.0), 5.0))


def distance_m(confirmation: Confirmation, target: TargetState) -> float:
    """Ground distance from how the apparent size has changed."""
    return range_m(confirmation, target) * math.cos(target.elevation_rad)


def target_motion(
    confirmation: Confirmation,
    target: TargetState,
    own_velocity_ned_mps: Vec3,
    config: FollowConfig,
    ground_m: float | None = None,
) -> TargetMotion:
    """The target's horizontal velocity: what the line of sight does, plus what the vehicle does itself.

    ground_m: what height and depression say of the distance. Size is believed only so far away from it: a box
    half covered shrinks, and the vehicle must not run after it.
    """
    distance = distance_m(confirmation, target)
    # Whatever the ground has led the range to since: on a hillside the ground is wrong, and the size comes nearer.
    nearest = distance * min(confirmation.confirmed_range_m / confirmation.range_m, 1.0)
    north, east = math.cos(target.azimuth_rad), math.sin(target.azimuth_rad)
    own_n, own_e, _ = own_velocity_ned_mps
    own_radial, own_tangential = own_n * north + own_e * east, own_e * north - own_n * east
    opening = sure = -target.log_size_rate_ps - math.tan(target.elevation_rad) * target.elevation_rate_rps
    if ground_m is not None and confirmation.ground_factor is not None:
        ground_m *= confirmation.ground_factor
        lever = 2 / math.sin(-2 * target.elevation_rad)  # share of the distance in one radian of depression
        tolerance = math.exp(config.size_tolerance * target.size_trust + config.depression_std_rad * lever)
        nearest = min(nearest, ground_m)
        distance = min(max(distance, ground_m / tolerance), ground_m * tolerance)
        ground_ps, slack_ps = target.elevation_rate_rps * lever, config.size_rate_tolerance_ps * target.size_trust
        sure = max(opening, ground_ps)
        opening = min(max(opening, ground_ps - slack_ps), ground_ps + slack_ps)
    spread = config.target_velocity_std_mps
    radial_fade = fade(distance * target.log_size_rate_std_ps, spread)
    radial_mps = (own_radial + distance * opening) * radial_fade
    tangential_mps = own_tangential + distance * target.azimuth_rate_rps
    tangential_mps *= fade(distance * target.azimuth_rate_std_rps, spread)
    return TargetMotion(
        distance_m=distance,
        nearest_m=nearest,
        radial_mps=radial_mps,
        sure_radial_mps=(own_radial + distance * sure) * radial_fade,
        tangential_mps=tangential_mps,
        own_radial_mps=own_radial,
        own_tangential_mps=own_tangential,
        steady_radial_mps=radial_mps,
        steady_tangential_mps=tangential_mps,
        coming_mps=own_radial + distance * opening * _since(opening, config),
    )


def _since(opening_ps: float, config: FollowConfig) -> float:
    """The distance that a rate of its logarithm belongs to, over the present one: the filter is rate_lag_s late.

    Of what comes straight at us at 8 m/s and is now 12 m away, the filter's rate is still that of 16 m.
    """
    return math.exp(min(max(-opening_ps * config.rate_lag_s, 0.0), _MOST_SINCE))


def believe(before: Belief | None, motion: TargetMotion, trust: float, now_s: float, config: FollowConfig) -> Belief:
    """What of the new motion's radial velocity to believe.

    trust: 1 where the box was whole; of a covered one the velocity is kept for a while, then given up. Nothing
    on the ground changes its velocity faster than target_acceleration_mps2; but where size and depression both
    say that it comes nearer, that is believed at once.
    """
    if before is None:
        return Belief(now_s, motion.radial_mps, 0.0, 0.0)
    dt_s = max(now_s - before.t_s, 0.0)
    blind_s = before.blind_s + dt_s if trust < 0.5 else 0.0
    kept, kept_steady = before.radial_mps, before.steady_mps
    if blind_s > config.blind_hold_s:
        faded = math.exp(-dt_s / config.blind_fade_s)
        kept, kept_steady = kept * faded, kept_steady * faded
    wanted = kept + trust * (motion.radial_mps - kept)
    step = config.target_acceleration_mps2 * dt_s
    limited = before.radial_mps + min(max(wanted - before.radial_mps, -step), step)
    if trust >= 0.5:
        limited = min(limited, motion.sure_radial_mps + config.approach_margin_mps)
    share = 1 - math.exp(-dt_s / max(config.target_velocity_lag_s, 1e-3))
    steady = kept_steady + min(max(trust * share * (motion.radial_mps - kept_steady), -step), step)
    across = before.steady_tangential_mps
    across += share * (motion.tangential_mps - across)
    return Belief(now_s, limited, steady, across, blind_s)


def fade(std: float, half_at: float) -> float:
    """How much of a feed-forward to believe: 1 when certain, one half at half_at, towards 0 beyond."""
    return 1.0 / (1.0 + (std / half_at) ** 2)

"""Settings of estimation, laws and state machine: frozen, each with the range it may be chosen from."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

from control.checks import check_ranges, ranged
from control.gate_limits import Limits


@dataclass(frozen=True, slots=True)
class EstimatorConfig:
    """Noise of the target filter: what the target may do, and how well a box of full confidence is placed."""

    # Power spectral density of the angular acceleration is its square times one second. In azimuth: of a target that
    # goes straight on; of one seen to turn; and, for the gate, of 5 m/s thrown round on the spot 15 m away.
    calm_acceleration_rps2: float = ranged(0.005, 0.04, 5.0)
    bearing_acceleration_rps2: float = ranged(0.01, 1.2, 5.0)
    gate_acceleration_rps2: float = ranged(0.01, 2.0, 10.0)
    elevation_acceleration_rps2: float = ranged(0.01, 0.15, 5.0)
    log_size_acceleration_ps2: float = ranged(0.01, 0.15, 5.0)
    bearing_std_rad: float = ranged(0.0002, 0.005, 0.2)
    log_size_std: float = ranged(0.002, 0.04, 1.0)
    initial_bearing_rate_std_rps: float = ranged(0.01, 0.5, 5.0)
    initial_log_size_rate_std_ps: float = ranged(0.01, 0.3, 5.0)
    # The standard deviations above are divided by the confidence; below the floor a box is not used at all.
    confidence_floor: float = ranged(0.01, 0.2, 1.0)
    gate_chi2: float = ranged(1.0, 13.82, 50.0)  # of the bearing: chi-square, 2 degrees of freedom, 99.9 %
    size_gate_chi2: float = ranged(1.0, 10.83, 50.0)  # 1 degree of freedom; outside it only the bearing counts
    size_rejections: int = field(default=20, metadata={"low": 1, "high": 200})  # in a row: begin with the new size
    max_log_size_rate_ps: float = ranged(0.1, 0.5, 5.0)
    # A box whose ln(width / height) changes faster than a target turns is taken to be covered from one side.
    log_aspect_rate_ps: float = ranged(0.05, 0.25, 10.0)
    log_aspect_tolerance: float = ranged(0.0, 0.15, 2.0)
    covered_factor: float = ranged(0.0, 6.0, 10.0)  # noise over what one covered box may mislead by
    rate_hold_s: float = ranged(0.0, 0.3, 2.0)  # unmeasured for so long, the rates of elevation and size fade,
    rate_fade_s: float = ranged(0.05, 0.6, 10.0)  # with this time constant
    history_s: float = ranged(0.1, 1.0, 5.0)  # a measurement may come this late

    def __post_init__(self) -> None:
        check_ranges(self)


class Altitude(Enum):
    """Which height is held while following."""

    HELD = "held"  # the vehicle's own above home, as at confirmation
    RELATIVE = "relative"  # that above the target, as at confirmation: the target may climb


@dataclass(frozen=True, slots=True)
class FollowConfig:
    """Gains and limits of the follow laws."""

    yaw_gain_ps: float = ranged(0.1, 4.0, 10.0)  # of large errors; of small ones it is less
    # The vehicle's yaw-rate loop, answered ahead of time: its first-order lag, and how late a command begins to act
    # (command link and dead time). PX4's; a vehicle that is quicker, or half as quick, is followed with them too.
    yaw_lag_s: float = ranged(0.05, 0.45, 1.0)
    yaw_delay_s: float = ranged(0.0, 0.07, 0.5)
    feed_forward_std_rps: float = ranged(0.01, 1.0, 5.0)  # std of the bearing rate at which half is left
    range_gain_ps: float = ranged(0.05, 0.3, 2.0)
    target_velocity_gain: float = ranged(0.0, 1.0, 1.0)  # how far the vehicle moves along with the target
    target_velocity_lag_s: float = ranged(0.0, 2.2, 5.0)  # smoothing of it: what turns round sooner is not followed
    sideways_gain: float = ranged(0.0, 0.3, 1.0)  # the same for what it moves across, in follow mode
    target_velocity_std_mps: float = ranged(0.1, 10.0, 20.0)  # std of it at which half is left
    rate_lag_s: float = ranged(0.0, 0.6, 2.0)  # how late the filter's rates are, for matching own velocity
    # How far size may differ from what height and depression say: ln of the distance, its rate, and on top of the
    # first an angle that depression may be wrong by.
    size_tolerance: float = ranged(0.0, 0.12, 2.0)
    size_rate_tolerance_ps: float = ranged(0.0, 0.15, 2.0)
    depression_std_rad: float = ranged(0.0, math.radians(1), math.radians(20))
    target_acceleration_mps2: float = ranged(0.5, 2.0, 20.0)
    approach_margin_mps: float = ranged(0.0, 1.5, 20.0)  # more than so much nearer a second: whatever the above
    blind_hold_s: float = ranged(0.0, 1.0, 5.0)  # the velocity of a target half covered is kept so long, then it
    blind_fade_s: float = ranged(0.05, 1.0, 10.0)  # fades with this time constant
    height_gain_ps: float = ranged(0.05, 0.8, 2.0)
    station_gain_ps: float = ranged(0.05, 0.5, 2.0)  # spotlight holds its place
    max_station_speed_mps: float = ranged(0.1, 2.0, 5.0)
    orbit_speed_mps: float = ranged(-8.0, 2.0, 8.0)  # around the target, clockwise seen from above positive
    orbit_acceleration_mps2: float = ranged(0.1, 1.0, 2.5)  # the circle's v² / r; slower where it would be more
    orbit_yaw_frac: float = ranged(0.05, 0.5, 0.9)  # the same for v / r, as a share of max_yaw_rate_rps
    standoff_speed_mps: float = ranged(0.1, 1.0, 3.0)  # how fast a new standoff is taken up while following
    altitude: Altitude = Altitude.HELD
    max_speed_mps: float = ranged(0.1, 7.0, 12.0)
    max_vertical_mps: float = ranged(0.1, 0.8, 1.5)
    max_yaw_rate_rps: float = ranged(0.05, math.radians(90), math.radians(90))
    min_distance_m: float = ranged(1.5, 3.0, 50.0)
    max_distance_m: float = ranged(5.0, 80.0, 200.0)
    min_depression_rad: float = ranged(math.radians(1), math.radians(4), math.radians(45))
    response_s: float = ranged(0.1, 0.9, 3.0)  # until a vehicle brakes; the latency comes on top
    braking_mps2: float = ranged(0.5, 3.5, 4.0)
    time_to_collision_s: float = ranged(1.0, 3.0, 10.0)
    closing_confidence: float = ranged(0.0, 0.4, 1.0)  # below it distance may only grow
    full_confidence: float = ranged(0.0, 0.6, 1.0)  # from it on full speed
    view_margin_frac: float = ranged(0.0, 0.12, 0.45)  # of the picture's height, kept free at top and bottom
    min_acceleration_mps2: float = ranged(0.2, 0.8, 3.0)  # always allowed, whatever the picture
    lead_s: float = ranged(0.0, 0.1, 0.5)  # command link and half a command period, where the link does not tell

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.min_distance_m >= self.max_distance_m:
            raise ValueError(f"min_distance_m {self.min_distance_m:g} must be below max_distance_m")
        if self.closing_confidence > self.full_confidence:
            raise ValueError("closing_confidence must not be above full_confidence")


@dataclass(frozen=True, slots=True)
class ShapingConfig:
    """How quickly requests may change; the gate's own limits are a little looser."""

    acceleration_mps2: float = ranged(0.2, 2.5, 4.0)
    braking_mps2: float = ranged(0.5, 3.5, 4.0)
    jerk_mps3: float = ranged(0.5, 5.0, 50.0)
    braking_jerk_mps3: float = ranged(0.5, 20.0, 100.0)
    yaw_acceleration_rps2: float = ranged(0.1, math.radians(180), math.radians(300))  # of the vehicle, as predicted
    # Of the command. What moves is the vehicle behind its own yaw loop: to buy it an acceleration the command must
    # lead by lag * acceleration, 81 deg/s at the values above. A slower slope is lost time at every turn.
    yaw_slope_rps2: float = ranged(0.1, math.radians(1000), math.radians(1100))

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, slots=True)
class EngagementConfig:
    """Times and thresholds of the follow state machine (docs/safety.md)."""

    target_age_s: float = ranged(0.1, 0.3, 0.5)  # T_frame: older is unseen
    lost_s: float = ranged(0.5, 1.0, 1.0)  # T_lost: velocity is zero
    release_s: float = ranged(1.0, 3.0, 5.0)  # T_release: hold
    request_age_s: float = ranged(0.05, 0.2, 0.2)  # T_req: zero
    stall_s: float = ranged(0.3, 1.0, 1.0)  # requests stalled: hold
    telemetry_age_s: float = ranged(0.1, 0.5, 0.5)
    heartbeat_age_s: float = ranged(1.1, 3.0, 3.0)
    engage_s: float = ranged(0.2, 1.5, 3.0)  # until the vehicle says that the mode is ours
    hold_s: float = ranged(0.5, 2.0, 5.0)  # until the vehicle says that it holds, then silence
    lag_quiet_s: float = ranged(0.5, 2.0, 30.0)  # after a tick of our own later than request_age_s: no engaging
    max_rejections: int = field(default=5, metadata={"low": 1, "high": 10})
    confirm_confidence: float = ranged(0.1, 0.5, 1.0)
    max_latency_s: float = ranged(0.05, 0.4, 0.4)
    min_attitude_rate_hz: float = ranged(4.0, 4.0, 50.0)
    min_battery_frac: float = ranged(0.1, 0.3, 1.0)
    min_height_m: float = ranged(1.5, 3.0, 120.0)

    def __post_init__(self) -> None:
        check_ranges(self)
        if not self.target_age_s < self.lost_s < self.release_s:
            raise ValueError("target_age_s, lost_s and release_s must grow in this order")


@dataclass(frozen=True, slots=True)
class GimbalConfig:
    """Gains and limits of a camera on a gimbal: it turns to the target, the vehicle's nose slowly follows it."""

    gain_ps: float = ranged(0.2, 8.0, 15.0)
    lag_s: float = ranged(0.0, 0.1, 1.0)  # of the gimbal's own rate loop, answered ahead of time
    feed_forward_std_rps: float = ranged(0.01, 1.0, 5.0)  # std of the bearing rate at which half is left
    max_rate_rps: float = ranged(0.05, math.radians(90), math.radians(180))
    max_acceleration_rps2: float = ranged(0.5, math.radians(400), math.radians(2000))
    stop_margin_rad: float = ranged(0.0, math.radians(3), math.radians(30))  # kept free before a mechanical stop
    stop_gain_ps: float = ranged(0.2, 3.0, 10.0)  # the rate towards a stop, by the angle left
    hand_over_gain_ps: float = ranged(0.05, 0.5, 2.0)  # the nose, by the gimbal's angle from the middle
    dead_band_rad: float = ranged(0.0, math.radians(5), math.radians(45))
    max_hand_over_rps: float = ranged(0.05, math.radians(45), math.radians(90))
    pace_from_frac: float = ranged(0.05, 0.5, 0.95)  # of the way to a stop, where the nose takes up the bearing rate

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, slots=True)
class ControlConfig:
    """All of it; what a section leaves out keeps its default. ValueError where sections contradict."""

    estimator: EstimatorConfig = field(default_factory=EstimatorConfig)
    follow: FollowConfig = field(default_factory=FollowConfig)
    shaping: ShapingConfig = field(default_factory=ShapingConfig)
    engagement: EngagementConfig = field(default_factory=EngagementConfig)
    gimbal: GimbalConfig = field(default_factory=GimbalConfig)
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        pairs = (
            ("shaping.braking_mps2", self.shaping.braking_mps2, self.limits.max_acceleration_mps2),
            (
                "shaping.yaw_slope_rps2",
                self.shaping.yaw_slope_rps2,
                self.limits.max_yaw_acceleration_rps2,
            ),
            ("follow.max_speed_mps", self.follow.max_speed_mps, self.limits.max_speed_mps),
            ("follow.max_yaw_rate_rps", self.follow.max_yaw_rate_rps, self.limits.max_yaw_rate_rps),
            ("gimbal.max_hand_over_rps", self.gimbal.max_hand_over_rps, self.limits.max_yaw_rate_rps),
        )
        for name, value, ceiling in pairs:
            if value > ceiling:
                raise ValueError(f"{name} {value:g} is above the gate's limit of {ceiling:g}")

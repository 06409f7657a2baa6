"""Settings: every number has a range, and a fault names itself."""

import math
from dataclasses import fields

import pytest

from control.config import ControlConfig, EngagementConfig, EstimatorConfig, FollowConfig, ShapingConfig
from control.gate import Limits

SECTIONS = (EstimatorConfig, FollowConfig, ShapingConfig, EngagementConfig)


@pytest.mark.parametrize(
    ("section", "name"), [(s, f.name) for s in SECTIONS for f in fields(s) if f.name != "altitude"]
)
def test_every_setting_has_a_range_with_its_default_inside(section, name):
    field = next(f for f in fields(section) if f.name == name)
    low, high = field.metadata["low"], field.metadata["high"]
    assert low <= getattr(section(), name) <= high
    for bad in (low - 0.01, high + 0.01, math.nan, math.inf, "1", None, True):
        with pytest.raises(ValueError, match=rf"^{name} must be from .* to .*, not "):
            section(**{name: bad})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FollowConfig(min_distance_m=20.0, max_distance_m=10.0), "min_distance_m 20 must be below"),
        (lambda: FollowConfig(closing_confidence=0.9), "closing_confidence must not be above"),
        (lambda: EngagementConfig(lost_s=1.0, release_s=1.0), "must grow in this order"),
        (lambda: ControlConfig(limits=Limits(max_speed_mps=3.0)), "follow.max_speed_mps 7 is above the gate"),
        (lambda: ControlConfig(limits=Limits(max_acceleration_mps2=2.0)), "shaping.braking_mps2 3.5 is above"),
        (lambda: ControlConfig(limits=Limits(max_yaw_acceleration_rps2=1.0)), "shaping.yaw_slope_rps2"),
        (lambda: ControlConfig(limits=Limits(max_yaw_rate_rps=0.5)), "follow.max_yaw_rate_rps"),
    ],
)
def test_settings_that_contradict_each_other_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_defaults_agree_and_the_gate_is_looser_than_the_controller():
    config = ControlConfig()
    assert config.shaping.acceleration_mps2 < config.limits.max_acceleration_mps2
    assert config.shaping.braking_mps2 < config.limits.max_acceleration_mps2
    assert config.shaping.yaw_slope_rps2 < config.limits.max_yaw_acceleration_rps2
    assert config.follow.max_speed_mps < config.limits.max_speed_mps
    assert config.follow.max_vertical_mps < config.limits.max_descent_mps

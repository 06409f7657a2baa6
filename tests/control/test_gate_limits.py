"""Configuration can only tighten: every ceiling, written down a second time."""

import math
from dataclasses import MISSING, FrozenInstanceError, fields

import pytest

from control.checks import finite, fresh, vector
from control.fence import Fence
from control.gate import Limits
from control.gate_limits import stoppable_mps

RANGES = {
    "max_speed_mps": (0.1, 8.0, 12.0),
    "max_climb_mps": (0.0, 2.0, 3.0),
    "max_descent_mps": (0.0, 1.0, 1.5),
    "max_yaw_rate_rps": (0.0, math.radians(90), math.radians(90)),
    "max_acceleration_mps2": (0.5, 4.0, 5.0),
    "max_yaw_acceleration_rps2": (0.1, math.radians(1100), math.radians(1200)),
    "response_s": (0.5, 0.9, 3.0),
    "braking_mps2": (0.2, 2.0, 2.5),
    "request_age_s": (0.05, 0.2, 0.2),
    "telemetry_age_s": (0.1, 0.5, 0.5),
    "heartbeat_age_s": (1.1, 3.0, 3.0),
}
FENCE_RANGES = {
    "north_m": (-10_000.0, 0.0, 10_000.0),
    "east_m": (-10_000.0, 0.0, 10_000.0),
    "radius_m": (5.0, 150.0, 500.0),
    "operator_north_m": (-1000.0, 0.0, 1000.0),
    "operator_east_m": (-1000.0, 0.0, 1000.0),
    "operator_distance_m": (10.0, None, 500.0),
    "margin_m": (1.0, 1.5, 10.0),
    "min_height_m": (1.5, 3.0, 120.0),
    "max_height_m": (1.5, 60.0, 120.0),
}
BOTH = [(kind, name, *r) for kind, ranges in ((Limits, RANGES), (Fence, FENCE_RANGES)) for name, r in ranges.items()]
NEVER = {"min_height_m": {120.0}, "max_height_m": {1.5}}  # the floor must stay below the ceiling
CONTRADICTING = {"min_height_m": {"max_height_m": 120.0}, "max_height_m": {"min_height_m": 1.5}}


def test_every_limit_is_listed_here():
    assert {f.name for f in fields(Limits)} == {*RANGES, "fence"}
    assert {f.name for f in fields(Fence)} == {*FENCE_RANGES, "polygon_m", "polygon_deg"}
    assert all(f.default is not MISSING for f in fields(Fence))


@pytest.mark.parametrize(("kind", "name", "low", "default", "high"), BOTH)
def test_configuration_can_only_tighten_the_ceilings(kind, name, low, default, high):
    assert getattr(kind(), name) == default
    bad_values = [low - 0.01, high + 0.01, math.nan, math.inf, -math.inf, "3", True, 10**400]
    for bad in bad_values if default is None else [*bad_values, None]:
        with pytest.raises(ValueError, match=rf"^{name} must be from {low:g} to {high:g}, not "):
            kind(**{name: bad})
    others = CONTRADICTING.get(name, {})
    assert getattr(kind(**{**others, name: default}), name) == default
    for edge in {low, high} - NEVER.get(name, set()):
        assert getattr(kind(**{**others, name: edge}), name) == edge


def test_the_value_is_named():
    with pytest.raises(ValueError, match=r"^max_speed_mps must be from 0.1 to 12, not 12.5$"):
        Limits(max_speed_mps=12.5)


@pytest.mark.parametrize("floor_m", [40.0, 50.0])
def test_a_floor_at_or_above_the_ceiling_is_refused(floor_m):
    with pytest.raises(ValueError, match=rf"^min_height_m {floor_m:g} must be below max_height_m 40$"):
        Fence(min_height_m=floor_m, max_height_m=40.0)
    assert Fence(min_height_m=39.9, max_height_m=40.0).min_height_m == 39.9


def test_nothing_but_a_fence_is_a_fence():
    class Open(Fence):
        pass

    for bad in (None, 150.0, Open()):
        with pytest.raises(ValueError, match=r"^fence must be a Fence, not "):
            Limits(fence=bad)


def test_limits_are_frozen():
    with pytest.raises(FrozenInstanceError):
        Limits().max_speed_mps = 50.0
    with pytest.raises(FrozenInstanceError):
        Fence().radius_m = 5000.0


def test_what_counts_as_a_number():
    class Lying(float):
        def __abs__(self):
            return 0.0

    assert all(map(finite, (0, 1.5, -999_999_999.0, 999_999_999, 5e-324, -0.0)))
    bad_values = (None, True, "1", math.nan, math.inf, -math.inf, 1e9, -1e9, 10**400, 1e308, 1j, b"1", Lying(1e300))
    assert not any(map(finite, bad_values))


def test_what_counts_as_a_vector():
    class Pretending(tuple):
        pass

    assert vector((1.0, 2, -3.0))
    for bad in (
        (1.0, 2.0),
        (1.0, 2.0, 3.0, 4.0),
        [1.0, 2.0, 3.0],
        (1.0, 2.0, None),
        None,
        "abc",
        Pretending((1.0,) * 3),
    ):
        assert not vector(bad)


def test_a_stamp_may_be_as_old_as_allowed_and_a_tick_ahead():
    assert fresh(10.0, 10.5, 0.5)
    assert fresh(10.0, 9.96, 0.5)
    assert fresh(10.05, 10.05 - 0.05, 0.5) is (-0.05 <= 10.05 - 0.05 - 10.05)
    assert fresh(0.05, 0.0, 0.5)
    assert not fresh(10.0, 10.51, 0.5)
    assert not fresh(0.0501, 0.0, 0.5)
    for bad in (None, math.nan, True, "1"):
        assert not fresh(bad, 10.0, 0.5)
        assert not fresh(10.0, bad, 0.5)


@pytest.mark.parametrize("margin_m", [0.01, 1.0, 20.0])
def test_the_stopping_distance_of_the_stoppable_speed_is_the_margin(margin_m):
    limits = Limits(response_s=0.7, braking_mps2=1.7)
    v = stoppable_mps(margin_m, limits)
    assert v * 0.7 + v**2 / (2 * 1.7) == pytest.approx(margin_m)
    assert stoppable_mps(0.0, limits) == stoppable_mps(-5.0, limits) == 0.0

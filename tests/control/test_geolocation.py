"""Where the target is on the earth, against the ellipsoid itself; and how it is told, in time."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from control.gate_limits import Limits
from control.geolocation import Aim, moved_deg, offset_from_m, target_fix
from control.overrun import leaves_fence
from control.types import TargetState, VehicleState

A_M, F = 6378137.0, 1 / 298.257223563  # WGS84


def ecef_m(latitude_deg: float, longitude_deg: float) -> tuple[float, float, float]:
    """On the ellipsoid, earth-centred."""
    la, lo = math.radians(latitude_deg), math.radians(longitude_deg)
    e2 = F * (2 - F)
    n = A_M / math.sqrt(1 - e2 * math.sin(la) ** 2)
    return n * math.cos(la) * math.cos(lo), n * math.cos(la) * math.sin(lo), n * (1 - e2) * math.sin(la)


def north_east_m(place_deg: tuple[float, float], origin_deg: tuple[float, float]) -> tuple[float, float]:
    """In the tangent plane at the origin."""
    la, lo = map(math.radians, origin_deg)
    x, y, z = (p - o for p, o in zip(ecef_m(*place_deg), ecef_m(*origin_deg), strict=True))
    north = -math.sin(la) * math.cos(lo) * x - math.sin(la) * math.sin(lo) * y + math.cos(la) * z
    return north, -math.sin(lo) * x + math.cos(lo) * y


@pytest.mark.parametrize("latitude_deg", [-64.0, -33.9, 0.0, 47.4, 60.0])
@pytest.mark.parametrize("longitude_deg", [8.5, -179.999, 180.0])
def test_places_within_half_a_kilometre_are_right_to_a_decimetre(latitude_deg: float, longitude_deg: float) -> None:
    origin = (latitude_deg, longitude_deg)
    for k in range(16):
        wanted = 500 * math.cos(k * math.pi / 8), 500 * math.sin(k * math.pi / 8)
        place = moved_deg(origin, wanted)
        assert math.dist(north_east_m(place, origin), wanted) < 0.1
        assert offset_from_m(place, origin) == pytest.approx(wanted, abs=1e-6)
        assert -180.0 <= place[1] < 180.0


def target(azimuth_rad: float, elevation_rad: float) -> TargetState:
    return TargetState(
        10.0, azimuth_rad, 0.0, elevation_rad, 0.0, -2.0, 0.0, 0.01, 0.1, 0.05, 0.9, 9.9, 0, elevation_std_rad=0.02
    )


def test_the_line_of_sight_ends_at_the_target() -> None:
    true_ned_m = (12.0, -9.0, 8.2)
    azimuth = math.atan2(-9.0, 12.0)
    fix = target_fix(target(azimuth, -math.atan2(8.2, 15.0)), 15.0, 3.0, 1.0)
    assert fix is not None
    assert fix.offset_ned_m == pytest.approx(true_ned_m)
    # Away from us, (0.8, -0.6), at 3 m/s; clockwise round us, (0.6, 0.8), at 1 m/s.
    assert fix.velocity_ned_mps == pytest.approx((0.8 * 3 + 0.6, -0.6 * 3 + 0.8, 0.0))


def test_its_spread_is_long_along_the_line_of_sight() -> None:
    fix = target_fix(target(math.pi / 2, -0.5), 20.0)
    assert fix is not None
    north, east, down = fix.std_ned_m
    assert (north, east) == pytest.approx((20 * 0.01, 20 * 0.05))
    assert down > 20 * 0.02


def test_what_is_no_number_is_no_target() -> None:
    assert target_fix(target(0.0, -0.5), math.nan) is None


@given(st.lists(st.tuples(*[st.floats(-100, 100)] * 3), min_size=1, max_size=30))
def test_what_is_told_never_jumps(places: list[tuple[float, float, float]]) -> None:
    aim = Aim.begin(0.0, (0.0, 0.0, 0.0), (30.0, 0.0, 0.0), (1.0, 1.0, 1.0), 8.0)
    for k, place in enumerate(places, 1):
        after = aim.seen(0.05 * k, place, (1.0, 1.0, 1.0), 8.0)
        assert math.dist(after.position_ned_m, aim.position_ned_m) <= 8.0 * 0.05 * (1 + 1e-9)
        assert math.hypot(*after.velocity_ned_mps) <= 8.0 * (1 + 1e-9)
        aim = after


def test_a_target_at_constant_speed_is_told_without_lag_then_fades_and_stands() -> None:
    aim = Aim.begin(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 8.0)
    for k in range(1, 101):
        t_s = 0.05 * k
        aim = aim.seen(t_s, (2.0 * t_s, -1.0 * t_s, 0.0), (1.0, 1.0, 1.0), 8.0)
    assert aim.position_ned_m == pytest.approx((10.0, -5.0, 0.0), abs=0.01)
    assert aim.velocity_ned_mps == pytest.approx((2.0, -1.0, 0.0), abs=0.01)
    half = aim.fading(5.05, 0.5)
    assert half.velocity_ned_mps == pytest.approx((1.0, -0.5, 0.0), abs=0.01)
    assert half.position_ned_m == pytest.approx((10.05, -5.025, 0.0), abs=0.01)
    still = half.fading(6.0, 0.0)
    assert still.velocity_ned_mps == (0.0, 0.0, 0.0)
    assert still.position_ned_m == half.position_ned_m


def vehicle(north_m: float, north_mps: float, height_m: float = 10.0, down_mps: float = 0.0) -> VehicleState:
    return VehicleState(
        position_ned_m=(north_m, 0.0, -height_m), velocity_ned_mps=(north_mps, 0.0, down_mps), height_m=height_m
    )


@pytest.mark.parametrize(
    ("state", "leaves"),
    [
        (vehicle(100.0, 7.0), False),
        (vehicle(138.0, 7.0), True),  # it could not be stopped at 150 m any more
        (vehicle(138.0, -7.0), False),
        (vehicle(138.0, 1.0), False),
        (vehicle(0.0, 0.0, 10.0, 1.5), False),
        (vehicle(0.0, 0.0, 4.0, 2.5), True),
        (vehicle(0.0, 0.0, 58.0, -3.0), True),
    ],
)
def test_one_that_flies_by_itself_is_stopped_before_the_fence(state: VehicleState, leaves: bool) -> None:
    assert leaves_fence(state, Limits(), steered=False) is leaves
    assert leaves_fence(state, Limits()) is False
    assert leaves_fence(vehicle(149.0, 0.0), Limits()) is True

"""The gate near the fence: what runs at it too fast is taken away, and at it everything stops."""

import math
import random
from dataclasses import replace

import pytest

from control.fence import Fence, walls
from control.gate import Limits, Reason, gate
from control.gate_limits import bounds, height_bounds, kept, outside, stoppable_mps
from tests.control.gate_rig import HEALTHY, LIMITS, NOW, replace_time, request, settle

SQUARE = Limits(fence=Fence(polygon_m=((-50.0, -50.0), (-50.0, 50.0), (50.0, 50.0), (50.0, -50.0))))
SIDE_M = 150.0 * math.cos(math.pi / 64)  # of the polygon within the default circle


def at(north_m, east_m=0.0, height_m=20.0):
    return replace(HEALTHY, position_ned_m=(north_m, east_m, -height_m), height_m=height_m)


def test_towards_a_side_the_speed_is_what_can_be_stopped():
    setpoint, reason = settle((8.0, 0.0, 0.0), vehicle=at(SIDE_M - 6.0))
    v = setpoint.velocity_ned_mps[0]
    assert v * LIMITS.response_s + v**2 / (2 * LIMITS.braking_mps2) == pytest.approx(6.0)
    assert reason is Reason.FENCE


def test_away_from_a_side_and_along_it_nothing_is_trimmed():
    near = at(48.0)
    for velocity in ((0.0, 7.0, 0.0), (0.0, -7.0, 0.0), (-7.0, 0.0, 0.0), (-5.0, 5.0, 0.0)):
        assert settle(velocity, vehicle=near, limits=SQUARE)[1] is Reason.PASSED


def test_only_the_part_towards_a_side_is_taken_away():
    setpoint, reason = settle((4.0, 3.0, 0.5), vehicle=at(48.0), limits=SQUARE)
    assert setpoint.velocity_ned_mps == pytest.approx((stoppable_mps(2.0, SQUARE), 3.0, 0.5))
    assert reason is Reason.FENCE


def test_in_a_corner_both_sides_count():
    setpoint, _ = settle((4.0, 4.0, 0.0), vehicle=at(48.0, 47.0), limits=SQUARE)
    assert setpoint.velocity_ned_mps == pytest.approx((stoppable_mps(2.0, SQUARE), stoppable_mps(3.0, SQUARE), 0.0))


def wall(angle_deg, most_mps):
    return math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg)), most_mps


def test_what_pushes_at_another_wall_is_slowed_down():
    near = [wall(10, 0.5), wall(130, 0.5)]
    first = near[0][1] * 8 - 0.5  # taken away at the first wall, then at the second
    north, east = -first * near[0][0], 8 - first * near[0][1]
    taken = near[1][0] * north + near[1][1] * east - 0.5
    north, east = north - taken * near[1][0], east - taken * near[1][1]
    scale = 0.5 / (near[0][0] * north + near[0][1] * east)
    assert 0.1 < scale < 0.9
    assert kept(0.0, 8.0, near) == pytest.approx((north * scale, east * scale))


@pytest.mark.parametrize("seed", range(200))
def test_whatever_is_asked_no_wall_is_run_at(seed):
    rng = random.Random(seed)
    near = [wall(rng.uniform(0, 360), rng.choice((0.0, 0.3, 2.0))) for _ in range(rng.randrange(1, 6))]
    asked = rng.uniform(-8, 8), rng.uniform(-8, 8)
    north, east = kept(*asked, near)
    assert all(n * north + e * east <= most + 1e-9 for n, e, most in near)
    assert math.hypot(north, east) <= math.hypot(*asked) + 1e-9
    assert kept(north, east, near) == pytest.approx((north, east))  # what is within bounds stays as it is


def test_without_walls_nothing_changes():
    assert kept(3.0, -4.0, []) == (3.0, -4.0)
    assert kept(0.5, 0.0, [(1.0, 0.0, 0.5)]) == (0.5, 0.0)
    assert kept(0.0, 3.0, [(1.0, 0.0, 0.0)]) == (0.0, 3.0)


@pytest.mark.parametrize("limits", [LIMITS, Limits(max_speed_mps=5.0, response_s=1.5, braking_mps2=1.0)])
def test_only_walls_within_reach_count_and_all_of_those(limits):
    assert bounds(HEALTHY, limits) == []
    near = at(SIDE_M - 6.0)
    every = [(n, e, stoppable_mps(m, limits)) for n, e, m in walls(limits.fence, SIDE_M - 6.0, 0.0)]
    assert bounds(near, limits) == [bound for bound in every if bound[2] < limits.max_speed_mps]
    assert 3 < len(bounds(near, limits)) < 32


@pytest.mark.parametrize("past_m", [-1.49, 0.0, 0.1, 50.0])
def test_nearer_than_the_margin_everything_stops_even_inwards(past_m):
    flying, _ = settle((-5.0, 0.0, 0.0))
    for velocity in ((-5.0, 0.0, 0.0), (0.0, 0.0, -1.0)):
        setpoint, reason = gate(request(velocity, 0.3), at(SIDE_M + past_m), NOW, replace_time(flying), LIMITS)
        assert (setpoint.velocity_ned_mps, setpoint.yaw_rate_rps) == ((0.0, 0.0, 0.0), 0.0)
        assert reason is Reason.AT_FENCE


def test_the_margin_is_a_setting_and_no_more_than_that():
    wide = Limits(fence=Fence(margin_m=5.0))
    for limits in (LIMITS, wide):
        edge_m = SIDE_M - limits.fence.margin_m
        assert not outside((edge_m - 0.01, 0.0, 0.0), 20.0, limits)
        assert outside((edge_m + 0.01, 0.0, 0.0), 20.0, limits)
        assert outside((0.0, -edge_m - 0.5, 0.0), 20.0, limits)
    assert not outside((47.0, 0.0, 0.0), 20.0, replace(SQUARE, fence=replace(SQUARE.fence, margin_m=3.0)))


@pytest.mark.parametrize(("height_m", "is_outside"), [(2.0, False), (1.99, True), (61.0, False), (61.01, True)])
def test_a_metre_past_floor_or_ceiling_is_outside(height_m, is_outside):
    assert outside((0.0, 0.0, 0.0), height_m, LIMITS) is is_outside
    reason = gate(request(), at(0.0, height_m=height_m), NOW, None, LIMITS)[1]
    assert reason is (Reason.AT_FENCE if is_outside else Reason.PASSED)


def test_the_fence_has_a_centre():
    limits = Limits(fence=Fence(north_m=100.0, east_m=-50.0, radius_m=20.0))
    assert settle((0.0, -0.5, 0.0), vehicle=at(100.0, -75.0), limits=limits)[1] is Reason.AT_FENCE
    assert settle((0.0, -0.5, 0.0), vehicle=at(100.0, -50.0), limits=limits)[1] is Reason.PASSED


def test_at_most_so_far_from_the_operator():
    limits = Limits(fence=Fence(operator_distance_m=50.0))
    assert settle((1.0, 0.0, 0.0), vehicle=at(-49.0), limits=limits)[1] is Reason.AT_FENCE
    assert settle((1.0, 0.0, 0.0), vehicle=at(-48.0), limits=limits)[1] is Reason.PASSED
    elsewhere = Limits(fence=Fence(operator_distance_m=50.0, operator_north_m=-20.0, operator_east_m=5.0))
    assert not outside((-60.0, 5.0, 0.0), 20.0, elsewhere)
    assert outside((-60.0, -30.0, 0.0), 20.0, elsewhere)


def test_a_side_that_jumps_nearer_stops_the_vehicle():
    flying, _ = settle((5.0, 0.0, 0.0))
    setpoint, reason = gate(request((5.0, 1.0, 0.0)), at(SIDE_M - 2.0), NOW, replace_time(flying), LIMITS)
    assert (setpoint.velocity_ned_mps, reason) == ((0.0, 0.0, 0.0), Reason.LIMIT_JUMPED)


def test_a_side_that_closes_in_slowly_is_paid_for_out_of_the_slew():
    before, _ = settle((3.0, 0.0, 0.0))
    setpoint, _ = gate(request((3.0, 3.0, 0.0)), at(SIDE_M - 4.9), NOW, replace_time(before), LIMITS)
    assert any(setpoint.velocity_ned_mps)
    assert math.dist(setpoint.velocity_ned_mps, before.velocity_ned_mps) <= 4.0 * 0.05 + 1e-9
    assert setpoint.velocity_ned_mps[0] < 3.0


def test_a_fence_in_degrees_lets_nothing_move_before_home_is_known():
    fence = Fence(polygon_deg=((47.0, 8.0), (47.002, 8.0), (47.002, 8.003), (47.0, 8.003)))
    assert settle((1.0, 0.0, 0.0), limits=Limits(fence=fence))[1] is Reason.AT_FENCE
    placed = Limits(fence=fence.placed(47.001, 8.0015))
    assert settle((1.0, 0.0, 0.0), limits=placed)[1] is Reason.PASSED


def test_what_flies_at_a_side_already_is_told_less():
    aside = bounds(replace(at(0.0, SIDE_M - 20.0), velocity_ned_mps=(1.0, 5.0, 0.0)), LIMITS)
    assert (pytest.approx(0.0), 1.0, pytest.approx(stoppable_mps(20.0 - 5.0 * LIMITS.response_s, LIMITS))) in aside
    standing = bounds(at(SIDE_M - 20.0), LIMITS)
    closing = bounds(replace(at(SIDE_M - 20.0), velocity_ned_mps=(5.0, 0.0, 0.0)), LIMITS)
    leaving = bounds(replace(at(SIDE_M - 20.0), velocity_ned_mps=(-5.0, 0.0, 0.0)), LIMITS)
    ahead = {(n, e): most for n, e, most in closing}
    assert ahead[1.0, 0.0] == pytest.approx(stoppable_mps(20.0 - 5.0 * LIMITS.response_s, LIMITS))
    assert leaving == standing
    assert (1.0, 0.0, pytest.approx(stoppable_mps(20.0, LIMITS))) in standing


@pytest.mark.parametrize(("down_mps", "sink_m", "rise_m"), [(0.0, 2.0, 55.0), (1.0, 1.1, 55.0), (-2.0, 2.0, 53.2)])
def test_what_sinks_or_climbs_already_is_told_less(down_mps, sink_m, rise_m):
    vehicle = replace(at(0.0, height_m=5.0), velocity_ned_mps=(0.0, 0.0, down_mps))
    assert height_bounds(vehicle, LIMITS) == pytest.approx(
        (stoppable_mps(sink_m, LIMITS), stoppable_mps(rise_m, LIMITS))
    )


def test_a_velocity_that_is_no_velocity_is_flying_blind():
    for bad in (None, (1.0, 0.0), (math.nan, 0.0, 0.0), (0.0, 0.0, math.inf)):
        vehicle = replace(HEALTHY, velocity_ned_mps=bad)
        assert gate(request(), vehicle, NOW, None, LIMITS)[1] is Reason.TELEMETRY_STALE


@pytest.mark.parametrize("fast_mps", [-7.0, 1.0, 7.0])
def test_what_flies_fast_along_a_side_keeps_further_from_it(fast_mps):
    vehicle = replace(at(48.0), velocity_ned_mps=(0.0, fast_mps, 0.0))
    ahead = {(round(n), round(e)): most for n, e, most in bounds(vehicle, SQUARE)}
    stop_s = SQUARE.response_s + abs(fast_mps) / (2 * SQUARE.braking_mps2)
    assert ahead[1, 0] == pytest.approx(min(2.0 / stop_s, stoppable_mps(2.0, SQUARE)))
    assert (ahead[1, 0] < stoppable_mps(2.0, SQUARE)) is (abs(fast_mps) > stoppable_mps(2.0, SQUARE))


def test_faster_than_allowed_reaches_further():
    vehicle = replace(at(SIDE_M - 25.0), velocity_ned_mps=(0.0, 12.0, 0.0))
    most = {(n, e): most for n, e, most in bounds(vehicle, LIMITS)}
    assert most[1.0, 0.0] == pytest.approx(25.0 / (0.9 + 12.0 / 4.0))


def test_past_a_side_there_is_no_speed_towards_it():
    vehicle = replace(at(49.0), velocity_ned_mps=(5.0, 0.0, 0.0))
    assert {(round(n), round(e)): most for n, e, most in bounds(vehicle, SQUARE)}[1, 0] == 0.0


def test_fast_along_another_side_and_very_near():
    vehicle = replace(at(0.0, 49.5), velocity_ned_mps=(7.0, 0.0, 0.0))
    ahead = {(round(n), round(e)): most for n, e, most in bounds(vehicle, SQUARE)}
    assert ahead[0, 1] == pytest.approx(0.5 / (SQUARE.response_s + 7.0 / (2 * SQUARE.braking_mps2)))

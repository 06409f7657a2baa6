"""The step responses of the point mass against those measured on the real autopilots."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from sitl_mocks.dynamics import (
    ARDUPILOT,
    PX4,
    TICK_S,
    Airframe,
    Disturbance,
    Motion,
    MotionCommand,
    Multicopter,
    body_to_ned,
)


def hovering(airframe: Airframe, disturbance: Disturbance | None = None, tick_s: float = TICK_S) -> Multicopter:
    motion = Motion(position_ned_m=(0.0, 0.0, -50.0), on_ground=False)
    return Multicopter(airframe, disturbance or Disturbance(), motion, tick_s=tick_s)


def north(v: float) -> MotionCommand:
    return MotionCommand((v, 0.0, 0.0))


def down(v: float) -> MotionCommand:
    return MotionCommand((0.0, 0.0, v))


def turn(deg_s: float) -> MotionCommand:
    return MotionCommand(yaw_rate_rps=math.radians(deg_s))


def north_mps(m: Motion) -> float:
    return m.velocity_ned_mps[0]


def down_mps(m: Motion) -> float:
    return m.velocity_ned_mps[2]


def yaw_rate_dps(m: Motion) -> float:
    return math.degrees(m.yaw_rate_rps)


def step_response(
    airframe: Airframe,
    before: MotionCommand,
    after: MotionCommand,
    read: Callable[[Motion], float],
    tick_s: float = TICK_S,
) -> tuple[float, float, float]:
    """(t63, t90, final value) of a step after the first command has settled."""
    copter = hovering(airframe, tick_s=tick_s)
    for _ in range(3):
        copter.step(4.0, before)
    start = read(copter.motion)
    trace = []
    for tick in range(1, 2000):
        copter.tick(after)
        trace.append((tick * tick_s, read(copter.motion)))
    final = trace[-1][1]
    times = [next(t for t, v in trace if (v - start) / (final - start) >= part) for part in (0.63, 0.9)]
    return times[0], times[1], final


@pytest.mark.parametrize("tick_s", [TICK_S, 0.01])
@pytest.mark.parametrize(
    ("airframe", "before", "after", "read", "t63", "t90", "final"),
    [
        (PX4, north(0), north(3), north_mps, 0.69, 1.28, 3.0),
        (PX4, north(3), north(0), north_mps, 0.70, 1.33, 0.0),
        (PX4, north(0), north(8), north_mps, 0.91, 1.59, 8.0),
        (PX4, north(0), north(15), north_mps, 1.13, 1.93, 12.0),
        (PX4, down(0), down(-2), down_mps, 0.315, 0.69, -2.0),
        (PX4, turn(0), turn(30), yaw_rate_dps, 0.45, 0.95, 30.0),
        (ARDUPILOT, north(0), north(3), north_mps, 1.11, 1.70, 3.0),
        (ARDUPILOT, north(0), north(8), north_mps, 2.42, 3.37, 8.0),
        (ARDUPILOT, down(0), down(-2), down_mps, 1.40, 1.92, -2.0),
        (ARDUPILOT, turn(0), turn(30), yaw_rate_dps, 0.31, 0.39, 30.0),
        (ARDUPILOT, turn(0), turn(60), yaw_rate_dps, 0.36, 0.45, 60.0),
    ],
)
def test_step_response_is_the_measured_one(
    airframe: Airframe,
    before: MotionCommand,
    after: MotionCommand,
    read: Callable[[Motion], float],
    t63: float,
    t90: float,
    final: float,
    tick_s: float,
) -> None:
    got63, got90, got_final = step_response(airframe, before, after, read, tick_s)
    assert got63 == pytest.approx(t63, rel=0.15, abs=0.03)
    assert got90 == pytest.approx(t90, rel=0.15, abs=0.05)
    assert got_final == pytest.approx(final, rel=0.01, abs=0.01)


@pytest.mark.parametrize(
    ("airframe", "asked", "read", "reached"),
    [
        (PX4, north(15), north_mps, 12.0),
        (PX4, down(-5), down_mps, -3.0),
        (PX4, down(5), down_mps, 1.5),
        (PX4, turn(300), yaw_rate_dps, 200.0),
        (ARDUPILOT, north(15), north_mps, 10.0),
        (ARDUPILOT, down(-8), down_mps, -5.0),
        (ARDUPILOT, turn(300), yaw_rate_dps, 60.0),
    ],
)
def test_speed_limits(
    airframe: Airframe, asked: MotionCommand, read: Callable[[Motion], float], reached: float
) -> None:
    copter = hovering(airframe)
    for _ in range(3):
        copter.step(4.0, asked)
    assert read(copter.motion) == pytest.approx(reached, rel=0.01)


def test_px4_stays_within_2_percent_of_dead_time_and_first_order() -> None:
    copter = hovering(PX4)
    errors = []
    for tick in range(1, 800):
        copter.tick(north(3.0))
        t = tick * TICK_S
        fitted = 0.0 if t < 0.2 else 3.0 * (1.0 - math.exp(-(t - 0.2) / 0.48))
        errors.append((north_mps(copter.motion) - fitted) / 3.0)
    assert math.sqrt(sum(e * e for e in errors) / len(errors)) < 0.02


@pytest.mark.parametrize(("airframe", "lag_deg"), [(PX4, 19.0), (ARDUPILOT, 17.8)])
def test_velocity_lags_the_nose_while_turning(airframe: Airframe, lag_deg: float) -> None:
    copter = hovering(airframe)
    for _ in range(400):  # 20 s of body-frame setpoints at 20 Hz, turned by the yaw at reception
        velocity = body_to_ned((3.0, 0.0, 0.0), copter.motion.yaw_rad)
        copter.step(0.05, MotionCommand(velocity, math.radians(30)))
    velocity = copter.motion.velocity_ned_mps
    course = math.atan2(velocity[1], velocity[0])
    lag = math.degrees(math.remainder(copter.motion.yaw_rad - course, math.tau))
    assert lag == pytest.approx(lag_deg, abs=4.0)


def test_limits_hold_for_hard_commands() -> None:
    copter = hovering(ARDUPILOT)
    last = copter.motion.accel_ned_mps2
    for tick in range(4000):
        copter.tick(north(10.0 if tick % 800 < 400 else -10.0))
        accel = copter.motion.accel_ned_mps2
        assert math.hypot(accel[0], accel[1]) <= 2.5 + 1e-9
        assert abs(accel[0] - last[0]) <= 5.6 * TICK_S + 1e-9
        last = accel


def test_acceleration_tilts_the_nose_down_and_braking_up() -> None:
    copter = hovering(PX4)
    copter.step(0.35, north(8.0))
    assert math.degrees(copter.motion.pitch_rad) < -20.0
    assert copter.motion.roll_rad == pytest.approx(0.0, abs=1e-9)
    copter.step(4.0, north(8.0))
    copter.step(0.35, north(0.0))
    assert math.degrees(copter.motion.pitch_rad) > 20.0


def test_accelerating_to_the_right_rolls_right() -> None:
    copter = hovering(PX4)
    copter.motion.yaw_rad = math.radians(90)  # nose east, so south is right
    copter.step(0.35, north(-5.0))
    assert math.degrees(copter.motion.roll_rad) > 10.0
    assert math.degrees(copter.motion.pitch_rad) == pytest.approx(0.0, abs=0.5)


def test_yaw_angle_setpoint_turns_the_short_way() -> None:
    copter = hovering(PX4)
    copter.motion.yaw_rad = math.radians(170)
    for _ in range(10):
        copter.step(1.0, MotionCommand(yaw_rad=math.radians(-170)))
        assert abs(copter.motion.yaw_rad) > math.radians(165)
    assert math.degrees(copter.motion.yaw_rad) == pytest.approx(-170.0, abs=0.5)


def test_uncontrolled_axes_coast_like_px4_without_sticks() -> None:
    copter = hovering(PX4)
    copter.step(4.0, north(3.07))
    copter.step(1.0, MotionCommand((math.nan, math.nan, 0.6)))
    assert north_mps(copter.motion) == pytest.approx(2.56, rel=0.1)
    copter.step(4.0, MotionCommand((math.nan, math.nan, 0.6)))
    assert north_mps(copter.motion) == pytest.approx(0.96, rel=0.1)


def test_the_ground_stops_a_descent() -> None:
    copter = hovering(PX4)
    copter.motion.position_ned_m = (0.0, 0.0, -1.0)
    for _ in range(2):
        copter.step(2.0, down(1.0))
    assert copter.motion.on_ground
    assert copter.motion.position_ned_m[2] == 0.0
    copter.step(2.0, down(-1.0))
    assert copter.motion.position_ned_m[2] < -1.0


def test_wander_repeats_for_a_seed_and_wind_only_tilts() -> None:
    def fly(disturbance: Disturbance) -> Motion:
        copter = hovering(PX4, disturbance)
        for _ in range(20):
            copter.step(0.5, MotionCommand())
        return copter.motion

    first, again = fly(Disturbance(wander_std_mps=0.1, seed=4)), fly(Disturbance(wander_std_mps=0.1, seed=4))
    other = fly(Disturbance(wander_std_mps=0.1, seed=5))
    assert first.position_ned_m == again.position_ned_m
    assert first.position_ned_m != other.position_ned_m
    windy = fly(Disturbance(wind_ned_mps=(5.0, 0.0, 0.0)))
    assert windy.position_ned_m == pytest.approx((0.0, 0.0, -50.0), abs=1e-6)
    assert windy.pitch_rad == pytest.approx(math.atan2(0.2 * 5.0, 9.80665), abs=1e-6)


@pytest.mark.parametrize("dt_s", [-0.1, math.nan, math.inf])
def test_a_bad_time_step_is_refused(dt_s: float) -> None:
    with pytest.raises(ValueError, match="dt_s"):
        hovering(PX4).step(dt_s, MotionCommand())

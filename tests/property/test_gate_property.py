"""Promises of the gate for any input at all: it never raises, and what it lets out is finite and bounded."""

import math
import os
import random

from hypothesis import given, settings
from hypothesis import strategies as st

from control.fence import Fence
from control.gate import Limits, Setpoint, gate
from control.types import VehicleMode, VehicleState, VelocityRequest

# `make gate-million` raises both, `make mutate` lowers them.
EXAMPLES = int(os.environ.get("GATE_EXAMPLES", "150"))
CALLS = int(os.environ.get("GATE_CALLS", "30000"))
EPS = 1e-6
JUNK = (None, math.nan, math.inf, -math.inf, 10**400, 5e-324, -0.0, "1", True, (), [1.0], 1e308, -1e308, b"x")


def check(setpoint, previous, limits):
    """The two promises of control/gate.py, stated independently of it."""
    if setpoint is None:
        return
    vn, ve, vd = setpoint.velocity_ned_mps
    yaw = setpoint.yaw_rate_rps
    assert all(map(math.isfinite, (setpoint.t_s, vn, ve, vd, yaw)))
    assert math.hypot(vn, ve) <= limits.max_speed_mps + EPS
    assert -limits.max_climb_mps - EPS <= vd <= limits.max_descent_mps + EPS
    assert abs(yaw) <= limits.max_yaw_rate_rps + EPS
    if (vn, ve, vd, yaw) == (0.0, 0.0, 0.0, 0.0):
        return
    before, dt = ((0.0, 0.0, 0.0), 0.05)
    before_yaw = 0.0
    if isinstance(previous, Setpoint):
        before, before_yaw = previous.velocity_ned_mps, previous.yaw_rate_rps
        dt = min(max(setpoint.t_s - previous.t_s, 0.0), 0.1)
    assert math.dist((vn, ve, vd), before) <= limits.max_acceleration_mps2 * dt + EPS
    assert abs(yaw - before_yaw) <= limits.max_yaw_acceleration_rps2 * dt + EPS


any_number = st.one_of(st.floats(), st.integers(), st.sampled_from(JUNK), st.floats(-20, 20))
any_stamp = st.one_of(any_number, st.floats(99.0, 101.0))
any_vector = st.one_of(st.tuples(any_number, any_number, any_number), st.lists(any_number), any_number)
requests = st.one_of(
    st.none(),
    st.builds(VelocityRequest, any_stamp, any_vector, any_number, priming=st.sampled_from((True, False, None))),
)
vehicles = st.one_of(
    st.none(),
    st.builds(
        VehicleState,
        heartbeat_t_s=any_stamp,
        mode=st.sampled_from((*VehicleMode, None, VehicleMode.EXTERNAL, VehicleMode.EXTERNAL)),
        mode_t_s=any_stamp,
        armed=st.sampled_from((True, True, True, False, None)),
        failsafe=st.sampled_from((False, False, False, True, None)),
        attitude_t_s=any_stamp,
        position_t_s=any_stamp,
        position_ned_m=any_vector,
        velocity_ned_mps=any_vector,
        height_m=any_number,
    ),
)


@settings(max_examples=EXAMPLES, deadline=None)
@given(st.lists(st.tuples(requests, vehicles, any_stamp), min_size=1, max_size=4))
def test_any_input_gives_nothing_or_something_safe(calls):
    limits, previous = Limits(), None
    for request, vehicle, now in calls:
        setpoint, _ = gate(request, vehicle, now, previous, limits)
        check(setpoint, previous, limits)
        previous = setpoint


@settings(max_examples=EXAMPLES, deadline=None)
@given(st.lists(st.tuples(*[st.floats(-30, 30)] * 6, st.floats(0.0, 0.15)), min_size=2, max_size=30))
def test_a_plausible_flight_never_steps_further_than_the_limits(ticks):
    limits, previous, now = Limits(fence=Fence(radius_m=25.0)), None, 100.0
    for vn, ve, vd, yaw, north, height, dt in ticks:
        now += dt
        request = VelocityRequest(now, (vn, ve, vd), yaw)
        setpoint, _ = gate(request, flying(now, (north, 0.0, -height), abs(height)), now, previous, limits)
        assert setpoint is not None
        check(setpoint, previous, limits)
        if north > 25.0:
            assert setpoint.velocity_ned_mps[0] <= EPS
        previous = setpoint


def flying(now, position, height):
    """A healthy vehicle."""
    return VehicleState(
        heartbeat_t_s=now, mode=VehicleMode.EXTERNAL, mode_t_s=now, armed=True, attitude_t_s=now,
        position_t_s=now, position_ned_m=position, height_m=height,
    )  # fmt: skip


def test_seeded_calls_are_safe():
    seed = 20260
    rng = random.Random(seed)
    limits, previous, now = Limits(), None, 100.0
    sent = moving = 0
    for n in range(CALLS):
        now += rng.uniform(0.0, 0.12)

        def number(scale, rng=rng):
            return rng.choice(JUNK) if rng.random() < 0.01 else rng.gauss(0, scale)

        def stamp(rng=rng, now=now):
            return rng.choice(JUNK) if rng.random() < 0.005 else now - rng.expovariate(10)

        request = VelocityRequest(stamp(), (number(8), number(8), number(2)), number(2))
        position = (number(60), number(60), -20.0)
        vehicle = VehicleState(
            heartbeat_t_s=stamp(), mode=VehicleMode.EXTERNAL, mode_t_s=stamp(), armed=rng.random() > 0.02,
            attitude_t_s=stamp(), position_t_s=stamp(), position_ned_m=position,
            velocity_ned_mps=(number(6), number(6), number(1)), height_m=number(40),
        )  # fmt: skip
        setpoint, _ = gate(request, vehicle, now, previous, limits)
        try:
            check(setpoint, previous, limits)
        except AssertionError as error:
            raise AssertionError(f"seed {seed}, call {n}: {request} {vehicle} {previous} {setpoint}") from error
        sent += setpoint is not None
        moving += setpoint is not None and any(setpoint.velocity_ned_mps)
        previous = setpoint
    assert sent > CALLS / 2  # the loop is worth something only if the gate often lets something out
    assert moving > CALLS / 10

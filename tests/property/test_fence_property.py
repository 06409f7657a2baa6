"""Whatever is asked for, in wind: never more than a metre outside, and what stopped there stays stopped."""

import math
import os
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from control.fence import Fence
from control.gate import Limits
from tests.property.fence_flight import ARDUCOPTER, PX4, beyond_circle, beyond_polygon, fly

FLIGHTS = int(os.environ.get("FENCE_FLIGHTS", "20"))
SQUARE = ((-30.0, -30.0), (-30.0, 30.0), (30.0, 30.0), (30.0, -30.0))
L_SHAPE = ((-10.0, -10.0), (60.0, -10.0), (60.0, 10.0), (10.0, 10.0), (10.0, 60.0), (-10.0, 60.0))
U_SHAPE = (
    (-20.0, -20.0),
    (30.0, -20.0),
    (30.0, 60.0),
    (14.0, 60.0),
    (14.0, 12.0),
    (-6.0, 12.0),
    (-6.0, 60.0),
    (-20.0, 60.0),
)
ARROW = ((-20.0, 0.0), (60.0, 40.0), (-20.0, 80.0), (10.0, 40.0))
NEEDLE = ((-12.0, -12.0), (90.0, 0.0), (-12.0, 12.0))
FENCES = {
    "circle": (Fence(radius_m=40.0), (0.0, 0.0), beyond_circle(0.0, 0.0, 40.0)),
    "small circle": (Fence(radius_m=12.0), (0.0, 0.0), beyond_circle(0.0, 0.0, 12.0)),
    "operator": (
        Fence(operator_distance_m=50.0, operator_north_m=-5.0), (0.0, 0.0), beyond_circle(-5.0, 0.0, 50.0),
    ),
    "square": (Fence(polygon_m=SQUARE), (0.0, 0.0), beyond_polygon(SQUARE)),
    "L": (Fence(polygon_m=L_SHAPE), (0.0, 0.0), beyond_polygon(L_SHAPE)),
    "U": (Fence(polygon_m=U_SHAPE), (5.0, -4.0), beyond_polygon(U_SHAPE)),
    "arrow": (Fence(polygon_m=ARROW), (30.0, 40.0), beyond_polygon(ARROW)),
    "needle": (Fence(polygon_m=NEEDLE), (0.0, 0.0), beyond_polygon(NEEDLE)),
}  # fmt: skip


def straight(angle, speed=8.0):
    """Full speed in one direction, for ever."""
    return lambda now_s, place: (speed * math.cos(angle), speed * math.sin(angle))


def hostile(beyond):
    """Full speed at whatever side is nearest."""

    def pilot(now_s, place):
        angles = [k * math.pi / 8 for k in range(16)]
        out = max(angles, key=lambda a: beyond((place[0] + math.cos(a), place[1] + math.sin(a))))
        return 8.0 * math.cos(out), 8.0 * math.sin(out)

    return pilot


def wild(seed):
    """Another direction and speed every second or so, jerks included."""
    rng = random.Random(seed)
    state = [0.0, 0.0, 0.0]

    def pilot(now_s, place):
        if now_s > state[2]:
            angle, speed = rng.uniform(0, 2 * math.pi), rng.uniform(0, 12)
            state[:] = [speed * math.cos(angle), speed * math.sin(angle), now_s + rng.expovariate(1.0)]
        return state[0], state[1]

    return pilot


def circling(radius, speed=8.0):
    """Round and round, always turning outwards too late."""
    return lambda now_s, place: (
        speed * math.cos(now_s * speed / radius), speed * math.sin(now_s * speed / radius),
    )  # fmt: skip


def pilots(beyond, seed):
    yield from (straight(k * math.pi / 4 + 0.1 * seed) for k in range(8))
    yield from (hostile(beyond), wild(seed), circling(10.0), circling(35.0))


@pytest.mark.parametrize("model", [PX4, ARDUCOPTER], ids=["px4", "arducopter"])
@pytest.mark.parametrize("name", FENCES)
def test_never_more_than_a_metre_outside(name, model):
    fence, start, beyond = FENCES[name]
    released = 0
    for seed, pilot in enumerate(pilots(beyond, 1)):
        flown = fly(Limits(fence=fence), start, pilot, model, beyond, seed=seed, s=15.0)
        assert flown.beyond_m < 1.0, (seed, flown)
        assert flown.moving > 10
        assert flown.moved_after == 0
        released += flown.released_s is not None
    assert released > 4  # at the fence it holds, and that is the end of the follow


@settings(max_examples=FLIGHTS, deadline=None)
@given(
    st.sampled_from(sorted(FENCES)),
    st.sampled_from((PX4, ARDUCOPTER)),
    st.integers(0, 10**9),
    st.sampled_from(("straight", "hostile", "wild", "circling")),
    st.floats(0, 2 * math.pi),
    st.floats(1.0, 12.0),
)
def test_any_flight_stays_within_a_metre(name, model, seed, kind, angle, speed):
    fence, start, beyond = FENCES[name]
    pilot = {
        "straight": straight(angle, speed), "hostile": hostile(beyond), "wild": wild(seed),
        "circling": circling(5.0 + 10.0 * angle, speed),
    }[kind]  # fmt: skip
    flown = fly(Limits(fence=fence), start, pilot, model, beyond, seed=seed, s=15.0)
    assert flown.beyond_m < 1.0
    assert flown.moved_after == 0


def test_without_the_gate_it_would_fly_out():
    """The test can fail: the same wind and requests, and a fence that is not there."""
    _, start, beyond = FENCES["square"]
    flown = fly(Limits(fence=Fence(radius_m=500.0)), start, straight(0.0), PX4, beyond, seed=1, s=15.0)
    assert flown.beyond_m > 20.0

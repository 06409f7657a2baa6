"""Nothing but the gate makes a Setpoint, and nothing that pretends to be its input gets one out of it."""

import copy
import dataclasses
import math
import pickle
from enum import Enum

import pytest

from control.gate import Limits, Reason, Setpoint, gate
from control.types import VehicleMode, VehicleState, VelocityRequest
from tests.control.gate_rig import HEALTHY, LIMITS, NOW, request


@pytest.fixture
def made():
    return gate(request(), HEALTHY, NOW, None, LIMITS)[0]


@pytest.mark.parametrize("token", [object(), None, True, Setpoint, "token"])
def test_without_the_token_there_is_no_setpoint(token):
    with pytest.raises(TypeError, match=r"^only control\.gate\.gate makes a Setpoint$"):
        Setpoint(NOW, (1.0, 0.0, 0.0), 0.0, token)


def test_the_token_is_not_in_the_setpoint(made):
    assert [f.name for f in dataclasses.fields(made)] == ["t_s", "velocity_ned_mps", "yaw_rate_rps"]
    assert not hasattr(made, "token") or made.token is not made
    with pytest.raises(AttributeError):
        made.__dict__  # noqa: B018


def test_a_setpoint_is_not_changed(made):
    with pytest.raises(dataclasses.FrozenInstanceError):
        made.yaw_rate_rps = 9.0
    with pytest.raises((TypeError, ValueError)):
        dataclasses.replace(made, velocity_ned_mps=(9.0, 0.0, 0.0))


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
def test_a_setpoint_is_not_copied_or_stored(made, copied):
    with pytest.raises(TypeError, match=r"^a Setpoint is sent once, and neither copied nor stored$"):
        copied(made)


def test_a_setpoint_has_no_children():
    with pytest.raises(TypeError, match=r"^nothing else is a Setpoint$"):
        type("Forged", (Setpoint,), {"__post_init__": lambda self, token: None})


class EagerRequest(VelocityRequest):
    """Says it is fresh whenever it is asked."""

    __slots__ = ()
    t_s = NOW
    velocity_ned_mps = (8.0, 0.0, 0.0)


class HealthyVehicle(VehicleState):
    """Always in external control."""

    __slots__ = ()
    mode = VehicleMode.EXTERNAL


class WideLimits(Limits):
    """Forgets its ranges."""

    __slots__ = ()

    def __post_init__(self):
        pass


class Mode(Enum):
    EXTERNAL = "external"


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ((object.__new__(EagerRequest), HEALTHY, NOW, None, LIMITS), Reason.NO_REQUEST),
        ((request(), object.__new__(HealthyVehicle), NOW, None, LIMITS), Reason.BAD_CALL),
        ((request(), HEALTHY, NOW, None, WideLimits(max_speed_mps=1e6)), Reason.BAD_CALL),
        ((request(), HEALTHY, True, None, LIMITS), Reason.BAD_CALL),
        ((request(), HEALTHY, "100.0", None, LIMITS), Reason.BAD_CALL),
        ((request(), dataclasses.replace(HEALTHY, mode=Mode.EXTERNAL), NOW, None, LIMITS), Reason.NOT_OURS),
        ((request(), dataclasses.replace(HEALTHY, armed=1), NOW, None, LIMITS), Reason.NOT_ARMED),
        ((request(), dataclasses.replace(HEALTHY, failsafe=0), NOW, None, LIMITS), Reason.FAILSAFE),
    ],
)
def test_what_only_pretends_gets_nothing(arguments, reason):
    assert gate(*arguments) == (None, reason)


class LyingFloat(float):
    """Small to whoever asks, large on the wire."""

    def __abs__(self):
        return 0.0

    def __mul__(self, other):
        return 0.0

    __rmul__ = __mul__


@pytest.mark.parametrize("velocity", [(LyingFloat(1e30), 0.0, 0.0), (0.0, LyingFloat(math.nan), 0.0), (0.0, 0.0, True)])
def test_numbers_that_lie_are_no_request(velocity):
    setpoint, reason = gate(request(velocity), HEALTHY, NOW, None, LIMITS)
    assert reason is Reason.REQUEST_INVALID
    assert setpoint.velocity_ned_mps == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("t_s", [1.7e9, -NOW, 0.0, NOW + 3600.0, NOW - 3600.0])
def test_a_request_of_another_clock_is_stale(t_s):
    setpoint, reason = gate(request((2.0, 0.0, 0.0), t_s=t_s), HEALTHY, NOW, None, LIMITS)
    assert reason is Reason.REQUEST_STALE
    assert setpoint.velocity_ned_mps == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("priming", [None, 1, "yes", 0])
def test_a_request_that_is_not_sure_whether_it_primes_moves_nothing(priming):
    unsure = request((2.0, 0.0, 0.0), priming=priming)
    setpoint, reason = gate(unsure, HEALTHY, NOW, None, LIMITS)
    assert (setpoint.velocity_ned_mps, reason) == ((0.0, 0.0, 0.0), Reason.PRIMING)
    held = dataclasses.replace(HEALTHY, mode=VehicleMode.HOLD)
    assert gate(unsure, held, NOW, None, LIMITS) == (None, Reason.NOT_OURS)


def test_what_goes_out_is_plain(made):
    assert type(made.velocity_ned_mps) is tuple
    assert {type(v) for v in (*made.velocity_ned_mps, made.yaw_rate_rps, made.t_s)} == {float}

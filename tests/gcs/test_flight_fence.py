"""A fence drawn on the map: nothing may fly before the vehicle has said where its home is."""

from __future__ import annotations

from dataclasses import replace

from control.config import ControlConfig
from control.engagement import Action, Cause, State
from control.fence import Fence
from control.gate import TICK_S, Limits
from control.types import VehicleMode
from gcs.flight_control import Act
from tests.gcs.flight_rig import Rig, moving

HOME_DEG = (47.0, 8.0)
AROUND = ((47.001, 7.999), (47.001, 8.001), (46.9995, 8.001), (46.9995, 7.999))  # 111 m north, 56 m south, 76 m east


def rig(corners: tuple[tuple[float, float], ...] = AROUND) -> Rig:
    return Rig(config=ControlConfig(limits=Limits(fence=Fence(polygon_deg=corners))))


def test_a_fence_in_degrees_refuses_until_home_is_known() -> None:
    flight = rig()
    flight.run(3.0)
    flight.select()
    flight.run(1.0)
    refused = flight.run(TICK_S, Act.CONFIRM)[0]
    assert Cause.OUTSIDE_FENCE in refused.output.reasons
    problem = "the fence is given in degrees, and the vehicle's home is not known yet"
    assert problem in flight.control.refusals(flight.now_s, refused.inputs.vehicle)
    flight.control.home_at(*HOME_DEG)
    assert flight.control.refusals(flight.now_s, flight.ticks[-1].inputs.vehicle) == ()
    assert flight.run(TICK_S, Act.CONFIRM)[0].output.action is Action.ENGAGE


def test_at_a_side_of_it_a_follow_ends_for_good() -> None:
    flight = rig()
    flight.control.home_at(*HOME_DEG)
    flight.follow()
    flight.target_ned_m = (24.0, 4.0, 0.0)
    assert moving(flight.run(1.0)[-1])
    flight.vehicle = replace(flight.vehicle, position_ned_m=(-55.0, 0.0, -9.0))
    assert flight.run(TICK_S)[0].output.reasons == (Cause.OUTSIDE_FENCE,)
    flight.vehicle = replace(flight.vehicle, position_ned_m=(0.0, 0.0, -9.0), mode=VehicleMode.HOLD)
    after = flight.run(3.0)
    assert all(tick.output.state is State.RELEASED and not moving(tick) for tick in after)


def test_a_home_that_moves_takes_the_frame_along() -> None:
    flight = rig()
    flight.control.home_at(*HOME_DEG)
    flight.run(1.0)
    assert not flight.ticks[-1].inputs.outside_fence
    flight.control.home_at(47.0, 8.0012)
    flight.run(TICK_S)
    assert flight.ticks[-1].inputs.outside_fence


def test_a_home_too_far_from_the_fence_is_said() -> None:
    flight = rig()
    flight.control.home_at(48.0, 8.0)
    flight.run(TICK_S)
    assert flight.ticks[-1].inputs.outside_fence
    refusals = flight.control.refusals(flight.now_s, flight.ticks[-1].inputs.vehicle)
    assert any("corner 1 must be within 20000 and 20000" in line for line in refusals)


def test_a_fence_in_metres_asks_for_no_home() -> None:
    flight = Rig()
    flight.control.home_at(48.0, 8.0)
    flight.run(TICK_S)
    assert not flight.ticks[-1].inputs.outside_fence

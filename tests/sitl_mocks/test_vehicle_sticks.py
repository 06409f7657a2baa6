"""Pilots with sticks: taking over, flying, and falling silent, as measured on PX4 and ArduCopter."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.vehicle import MockVehicle, Mode, Sticks
from tests.sitl_mocks.vehicle_bench import SET_MODE, Bench


def airborne(personality: str = "px4", **parameters: float) -> Bench:
    bench = Bench(MockVehicle(personality, airborne_m=20.0, parameters=parameters))
    bench.run(0.1)
    return bench


def joystick(bench: Bench, seconds: float, x: int = 0, z: int = 500) -> None:
    """MANUAL_CONTROL at 20 Hz."""
    for _ in range(round(seconds * 20)):
        bench.send(mavlink.MAVLink_manual_control_message(1, x, 0, z, 0, 0))
        bench.run(0.05)


@pytest.mark.parametrize(("override", "taken"), [(1, False), (3, True)])
def test_a_full_stick_takes_over_in_30_ms_only_where_the_parameter_says_so(override: int, taken: bool) -> None:
    bench = airborne(COM_RC_OVERRIDE=override)
    bench.engage(3.0)
    joystick(bench, 1.0)
    assert bench.vehicle.autopilot.mode is Mode.EXTERNAL  # centred sticks do nothing
    bench.send(mavlink.MAVLink_manual_control_message(1, 1000, 0, 500, 0, 0))
    bench.run(0.03)
    assert (bench.vehicle.autopilot.mode is Mode.POSITION) is taken
    assert bench.vehicle.autopilot.intended is bench.vehicle.autopilot.mode
    assert ("Pilot took over using sticks\t" in bench.texts()) is taken


def test_the_pilot_flies_by_deflection_and_stands_when_he_lets_go() -> None:
    bench = airborne()
    bench.vehicle.pilot_sets_mode(Mode.POSITION)
    joystick(bench, 4.0, x=500)
    assert bench.vehicle.pose().velocity_ned_mps[0] == pytest.approx(5.0, abs=0.1)
    joystick(bench, 5.0)
    assert bench.vehicle.pose().velocity_ned_mps == pytest.approx((0.0, 0.0, 0.0), abs=0.05)


def test_a_joystick_lost_in_offboard_is_hold_then_return() -> None:
    bench = airborne()
    bench.engage(0.5)
    joystick(bench, 1.0)
    last_s = bench.now_s - 0.05
    modes = [(bench.vehicle.autopilot.mode, bench.now_s)]
    while bench.now_s < last_s + 7.0:
        bench.run(0.01)
        if bench.vehicle.autopilot.mode is not modes[-1][0]:
            modes.append((bench.vehicle.autopilot.mode, bench.now_s))
    assert [mode for mode, _ in modes] == [Mode.EXTERNAL, Mode.HOLD, Mode.RETURN]
    assert modes[1][1] - last_s == pytest.approx(0.64, abs=0.03)
    assert modes[2][1] - modes[1][1] == pytest.approx(5.05, abs=0.06)
    assert bench.newest("HEARTBEAT").system_status == 5


@pytest.mark.parametrize("parameters", [{"COM_RCL_EXCEPT": 4.0}, {"NAV_RCL_ACT": 0.0}])
def test_a_joystick_lost_is_nothing_where_the_parameters_say_so(parameters: dict[str, float]) -> None:
    bench = airborne(**parameters)
    bench.engage(0.5)
    joystick(bench, 1.0)
    bench.run(3.0)
    assert bench.vehicle.autopilot.mode is Mode.EXTERNAL


def test_with_a_centred_joystick_offboard_loss_stops_within_3_s_and_holds_height() -> None:
    bench = airborne()
    bench.engage(3.0)
    bench.run(3.0)
    bench.vehicle.rc_sticks = Sticks()
    bench.run(0.5)
    bench.fall_silent()
    bench.run(1.1)
    assert bench.vehicle.autopilot.mode is Mode.POSITION
    bench.run(3.0)
    speed_mps = math.hypot(*bench.vehicle.pose().velocity_ned_mps)
    height_m = bench.vehicle.autopilot.flight.height_m
    bench.run(5.0)
    assert speed_mps < 0.2
    assert bench.vehicle.autopilot.flight.height_m == pytest.approx(height_m, abs=0.1)
    bench.vehicle.rc_sticks = None
    bench.run(0.7)
    assert not bench.vehicle.autopilot.sticks_present


def test_rc_channels_count_as_sticks() -> None:
    bench = airborne(COM_RC_OVERRIDE=3)
    bench.engage(1.0)
    bench.send(mavlink.MAVLink_rc_channels_override_message(1, 1, 1500, 1500, 1500, 1500, 0, 0, 0, 0))
    bench.run(0.03)
    assert bench.vehicle.autopilot.mode is Mode.EXTERNAL
    bench.send(mavlink.MAVLink_rc_channels_override_message(1, 1, 1500, 1000, 1500, 1500, 0, 0, 0, 0))
    bench.run(0.03)
    assert bench.vehicle.autopilot.mode is Mode.POSITION
    assert bench.vehicle.autopilot.flight.sticks.forward == pytest.approx(1.0)


def test_arducopter_ignores_sticks_in_guided_and_its_loiter_needs_the_throttle_up() -> None:
    bench = airborne("ardupilot", MAV_GCS_SYSID=245)
    bench.command(SET_MODE, 1.0, 4.0)
    joystick(bench, 1.0, x=1000)
    assert bench.vehicle.autopilot.mode is Mode.EXTERNAL
    assert bench.vehicle.pose().velocity_ned_mps[0] == pytest.approx(0.0, abs=0.05)
    bench.command(SET_MODE, 1.0, 5.0)
    joystick(bench, 3.0, z=500)
    assert bench.vehicle.pose().velocity_ned_mps[2] == pytest.approx(0.0, abs=0.1)
    joystick(bench, 4.0, z=0)
    assert bench.vehicle.pose().velocity_ned_mps[2] == pytest.approx(2.5, abs=0.2)

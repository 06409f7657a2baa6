"""Ceilings, the actions behind the parameters, and the radio: what the autopilots' own fences and failsafes do."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.vehicle import MockVehicle, Mode, Sticks
from tests.sitl_mocks.vehicle_bench import SET_MODE, Bench


def airborne(personality: str = "px4", **parameters: float) -> Bench:
    bench = Bench(MockVehicle(personality, airborne_m=20.0, parameters=parameters))
    bench.run(0.1)
    return bench


@pytest.mark.parametrize(("action", "mode"), [(0, Mode.EXTERNAL), (2, Mode.HOLD), (5, Mode.LAND)])
def test_px4s_ceiling(action: int, mode: Mode) -> None:
    bench = airborne(GF_ACTION=action, GF_MAX_VER_DIST=22.0)
    bench.engage(0.0)
    bench.velocity = (0.0, 0.0, -2.0, 0.0)
    bench.run(2.5)
    assert bench.vehicle.autopilot.mode is mode
    assert "Geofence violation: exceeding maximum altitude above Home\t" in bench.texts()


@pytest.mark.parametrize(("action", "mode"), [(0, Mode.EXTERNAL), (1, Mode.RETURN), (2, Mode.LAND), (4, Mode.BRAKE)])
def test_arducopters_ceiling(action: int, mode: Mode) -> None:
    bench = airborne("ardupilot", FENCE_ENABLE=1, FENCE_ALT_MAX=21.0, FENCE_ACTION=action)
    bench.command(SET_MODE, 1.0, 4.0)
    bench.velocity = (0.0, 0.0, -1.0, 0.0)
    bench.run(3.5)
    assert bench.vehicle.autopilot.mode is mode
    assert "Max Alt fence breached" in bench.texts()


@pytest.mark.parametrize(("enable", "mode"), [(2, Mode.RETURN), (3, Mode.RETURN), (4, Mode.LAND), (7, Mode.BRAKE)])
def test_arducopters_other_answers_to_a_lost_station(enable: int, mode: Mode) -> None:
    bench = airborne("ardupilot", FS_GCS_ENABLE=enable, MAV_GCS_SYSID=245)
    bench.heartbeats = True
    bench.command(SET_MODE, 1.0, 4.0)
    bench.run(1.0)
    bench.heartbeats = False
    bench.run(6.0)
    assert bench.vehicle.autopilot.mode is mode


@pytest.mark.parametrize(("options", "mode"), [(0, Mode.RETURN), (16, Mode.HOLD)])
def test_arducopter_may_spare_the_pilots_modes(options: int, mode: Mode) -> None:
    bench = airborne("ardupilot", FS_GCS_ENABLE=1, MAV_GCS_SYSID=245, FS_OPTIONS=options)
    bench.heartbeats = True
    bench.vehicle.rc_sticks = Sticks()
    bench.command(SET_MODE, 1.0, 5.0)
    bench.run(1.0)
    bench.heartbeats = False
    bench.run(6.0)
    assert bench.vehicle.autopilot.mode is mode


@pytest.mark.parametrize(("options", "mode"), [(0, Mode.RETURN), (4, Mode.EXTERNAL)])
def test_arducopters_radio_failsafe(options: int, mode: Mode) -> None:
    bench = airborne("ardupilot", FS_OPTIONS=options)
    bench.vehicle.rc_sticks = Sticks()
    bench.command(SET_MODE, 1.0, 4.0)
    bench.run(1.0)
    bench.vehicle.rc_sticks = None
    bench.run(1.2)
    assert bench.vehicle.autopilot.mode is mode


def test_arducopter_takes_a_parameter_of_any_type_px4_only_of_its_own() -> None:
    for personality, name, taken in (("ardupilot", b"FS_GCS_ENABLE", True), ("px4", b"NAV_DLL_ACT", False)):
        bench = Bench(MockVehicle(personality))
        bench.send(mavlink.MAVLink_param_set_message(1, 1, name, 2.0, 9))
        bench.run(0.05)
        assert (bench.vehicle.params[name.decode()] == 2.0) is taken


def test_px4s_heartbeat_disarmed_in_offboard_tells_whether_setpoints_flow() -> None:
    bench = Bench(MockVehicle())
    assert bench.command(SET_MODE, 129.0, 6.0, 0.0) == 0
    bench.run(1.1)
    first = bench.newest("HEARTBEAT")
    bench.velocity = (0.0, 0.0, 0.0, 0.0)
    bench.run(1.1)
    second = bench.newest("HEARTBEAT")
    bench.velocity = None
    bench.run(2.1)
    third = bench.newest("HEARTBEAT")
    seen = [(m.base_mode, m.system_status) for m in (first, second, third)]
    assert seen == [(0x01, 0), (0x11, 3), (0x01, 0)]

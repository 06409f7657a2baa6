"""GPS, estimator, battery and spoiled telemetry: that the faults happen and what the autopilots make of them."""

from __future__ import annotations

import itertools
import math

import pytest

from sitl_mocks.vehicle import MockVehicle, Mode, Result
from sitl_mocks.vehicle.streams import ATTITUDE, LOCAL_POSITION_NED
from tests.sitl_mocks.vehicle_bench import PX4_HOLD, PX4_OFFBOARD, SET_MODE, Bench


def airborne(personality: str = "px4", **parameters: float) -> Bench:
    bench = Bench(MockVehicle(personality, airborne_m=20.0, parameters=parameters))
    bench.run(0.1)
    return bench


def test_px4_leaves_offboard_when_its_velocity_is_no_longer_valid_and_comes_back_by_itself() -> None:
    bench = airborne()
    bench.engage(3.0)
    bench.run(4.0)
    bench.vehicle.faults.gps_lost = True
    bench.vehicle.faults.dead_reckoning_s = 2.0
    lost_s = bench.now_s
    bench.run(1.9)
    assert bench.vehicle.autopilot.mode is Mode.EXTERNAL
    assert bench.newest("GPS_RAW_INT").fix_type < 2
    bench.run(2.0)
    assert bench.vehicle.autopilot.mode is Mode.LAND  # its "Descend"
    assert bench.vehicle.autopilot.intended is Mode.EXTERNAL
    assert not bench.newest("ESTIMATOR_STATUS").flags & 0x06  # no velocity
    assert max(t for t, _ in bench.of("LOCAL_POSITION_NED")) < lost_s + 2.05
    assert max(t for t, _ in bench.of("GLOBAL_POSITION_INT")) < lost_s + 2.05
    velocity = bench.vehicle.pose().velocity_ned_mps
    assert velocity[0] > 1.5  # drifts on
    assert velocity[2] == pytest.approx(0.7, abs=0.1)
    assert bench.command(SET_MODE, *PX4_OFFBOARD) == Result.TEMPORARILY_REJECTED
    bench.vehicle.faults.gps_lost = False
    bench.run(0.2)
    assert bench.vehicle.autopilot.mode is Mode.EXTERNAL


def test_px4_with_sticks_falls_to_altitude_mode() -> None:
    bench = airborne()
    bench.engage(1.0)
    bench.vehicle.autopilot.sticks_present = True
    bench.vehicle.faults.gps_lost, bench.vehicle.faults.dead_reckoning_s = True, 0.0
    bench.run(0.1)
    assert bench.vehicle.autopilot.mode is Mode.ALTITUDE


def test_arducopter_lands() -> None:
    bench = airborne("ardupilot")
    bench.command(SET_MODE, 1.0, 4.0)
    bench.vehicle.faults.gps_lost, bench.vehicle.faults.dead_reckoning_s = True, 1.0
    bench.run(1.2)
    assert bench.vehicle.autopilot.mode is Mode.LAND
    assert bench.newest("HEARTBEAT").system_status == 5
    assert "EKF Failsafe" in bench.texts()
    bench.vehicle.faults.gps_lost = False
    bench.run(1.2)
    assert bench.vehicle.autopilot.mode is Mode.LAND
    assert bench.newest("HEARTBEAT").system_status == 4


def test_estimator_flags_can_be_anything() -> None:
    bench = airborne()
    bench.vehicle.faults.estimator_flags = 0x425
    bench.run(1.1)
    assert bench.newest("ESTIMATOR_STATUS").flags == 0x425


@pytest.mark.parametrize(("left", "charge"), [(0.5, 1), (0.15, 2), (0.07, 3), (0.05, 4)])
def test_the_charge_state_follows_the_battery_and_the_simulators_do_nothing_about_it(left: float, charge: int) -> None:
    bench = airborne()
    bench.vehicle.battery_frac = left
    bench.run(2.1)
    assert bench.newest("BATTERY_STATUS").charge_state == charge
    assert bench.newest("SYS_STATUS").battery_remaining == round(100 * left)
    assert bench.vehicle.autopilot.mode is Mode.HOLD


def test_with_the_supply_check_px4_returns_then_lands() -> None:
    bench = airborne(CBRK_SUPPLY_CHK=0)
    bench.vehicle.battery_frac = 0.06
    bench.run(0.1)
    assert bench.vehicle.autopilot.mode is Mode.RETURN
    bench.command(SET_MODE, *PX4_HOLD)  # a person may undo it
    bench.run(0.1)
    assert bench.vehicle.autopilot.mode is Mode.HOLD
    bench.vehicle.battery_frac = 0.04
    bench.run(1.1)
    assert bench.vehicle.autopilot.mode is Mode.LAND
    assert bench.newest("HEARTBEAT").system_status == 5


@pytest.mark.parametrize(("action", "mode"), [(0, Mode.BRAKE), (1, Mode.LAND), (2, Mode.RETURN)])
def test_arducopters_battery_failsafe(action: int, mode: Mode) -> None:
    bench = airborne("ardupilot", BATT_FS_LOW_ACT=action, BATT_LOW_VOLT=14.0)
    bench.vehicle.battery_frac = 0.1
    bench.run(0.1)
    assert bench.vehicle.autopilot.mode is mode


def test_a_battery_may_be_unknown_or_broken() -> None:
    bench = airborne()
    bench.vehicle.faults.battery_unknown = bench.vehicle.faults.battery_fault = True
    bench.run(2.1)
    assert bench.newest("SYS_STATUS").battery_remaining == bench.newest("BATTERY_STATUS").battery_remaining == -1
    assert not bench.newest("SYS_STATUS").onboard_control_sensors_health & 0x2000000
    assert bench.newest("BATTERY_STATUS").fault_bitmask
    assert bench.newest("BATTERY_STATUS").charge_state == 6


def test_streams_can_carry_nan_or_stand_still() -> None:
    bench = airborne()
    bench.engage(2.0)
    bench.run(2.0)
    bench.vehicle.faults.nan_streams = {ATTITUDE}
    bench.vehicle.faults.stale_streams = {LOCAL_POSITION_NED}
    bench.run(0.5)
    from_s = bench.now_s
    bench.run(0.5)
    assert all(math.isnan(m.roll) and math.isnan(m.yawspeed) for _, m in bench.of("ATTITUDE", from_s))
    stale = [m for _, m in bench.of("LOCAL_POSITION_NED", from_s)]
    assert len(stale) > 10
    assert len({(m.time_boot_ms, m.x) for m in stale}) == 1
    bench.vehicle.faults.nan_streams.clear()
    bench.vehicle.faults.stale_streams.clear()
    bench.run(0.1)
    assert math.isfinite(bench.newest("ATTITUDE").roll)
    assert bench.newest("LOCAL_POSITION_NED").x > stale[0].x


def test_the_echo_can_be_of_something_else() -> None:
    bench = airborne()
    bench.engage(2.0)
    bench.run(0.5)
    assert bench.newest("POSITION_TARGET_LOCAL_NED").vx == pytest.approx(2.0)
    bench.vehicle.faults.echo_offset_mps = 1.5
    bench.run(0.5)
    assert bench.newest("POSITION_TARGET_LOCAL_NED").vx == pytest.approx(3.5)


def test_0_9_hz_flaps_between_position_and_offboard_every_cycle() -> None:
    bench = airborne()
    bench.command(511, 436, 20_000)
    bench.engage(1.0)
    bench.setpoint_hz = 0.9
    from_s = bench.now_s
    bench.run(10.0)
    modes = [m.custom_mode for _, m in bench.of("CURRENT_MODE", from_s)]
    changes = sum(a != b for a, b in itertools.pairwise(modes))
    assert changes == pytest.approx(18, abs=3)

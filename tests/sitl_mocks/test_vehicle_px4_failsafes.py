"""PX4's failsafes and take-overs in the mock, against what was measured on PX4."""

from __future__ import annotations

import pytest

from sitl_mocks.vehicle import MockVehicle, Mode
from sitl_mocks.vehicle.modes import PX4_NUMBERS
from tests.sitl_mocks.vehicle_bench import PX4_HOLD, PX4_OFFBOARD, SET_MODE, Bench


def airborne(**parameters: float) -> Bench:
    bench = Bench(MockVehicle(airborne_m=20.0, parameters=parameters))
    bench.run(0.1)
    return bench


@pytest.mark.parametrize(("action", "mode"), [(0, Mode.POSITION), (3, Mode.RETURN), (4, Mode.LAND), (5, Mode.HOLD)])
def test_lost_setpoints_fail_safe_after_1_s_and_come_back_by_themselves(action: int, mode: Mode) -> None:
    bench = airborne(COM_OBL_RC_ACT=action)
    bench.command(511, 436, 20_000)
    bench.engage(3.0)
    bench.run(4.0)
    last_s = bench.fall_silent()
    bench.run(0.9)
    assert bench.vehicle.pose().velocity_ned_mps[0] == pytest.approx(3.0, abs=0.05)
    bench.run(1.2)
    changed_s = next(t for t, m in bench.of("CURRENT_MODE", last_s) if m.custom_mode == PX4_NUMBERS[mode])
    assert 0.98 <= changed_s - last_s <= 1.11
    assert bench.newest("CURRENT_MODE").intended_custom_mode == PX4_NUMBERS[Mode.EXTERNAL]
    assert bench.newest("HEARTBEAT").system_status == 5
    assert bench.texts(last_s) == ["Failsafe activated\t"]
    resumed_s = bench.now_s
    bench.velocity = (1.0, 0.0, 0.0, 0.0)
    bench.run(1.5)
    back = [t for t, m in bench.of("CURRENT_MODE", resumed_s) if m.custom_mode == PX4_NUMBERS[Mode.EXTERNAL]]
    assert 0.04 <= back[0] - resumed_s <= 0.09
    assert bench.newest("HEARTBEAT").system_status == 4


def test_the_default_failsafe_coasts_sinks_lands_and_disarms() -> None:
    bench = airborne()
    bench.engage(3.0)
    bench.run(4.0)
    bench.fall_silent()
    bench.run(1.1)
    start = bench.vehicle.pose()
    bench.run(5.0)
    later = bench.vehicle.pose()
    assert later.velocity_ned_mps[0] == pytest.approx(0.96, abs=0.15)
    sink_mps = (later.position_ned_m[2] - start.position_ned_m[2]) / 5.0
    assert 0.5 <= sink_mps <= 0.77
    bench.run(35.0)
    assert not bench.vehicle.autopilot.armed
    drift_m = bench.vehicle.pose().position_ned_m[0] - start.position_ned_m[0]
    assert drift_m == pytest.approx(13.0, abs=3.0)
    assert bench.vehicle.autopilot.mode is Mode.EXTERNAL  # the last intended one


def test_a_failsafe_hold_stops_and_keeps_its_place() -> None:
    bench = airborne(COM_OBL_RC_ACT=5)
    bench.engage(5.0)
    bench.run(4.0)
    bench.fall_silent()
    bench.run(6.0)
    held = bench.vehicle.pose()
    bench.run(5.0)
    assert bench.vehicle.pose().position_ned_m == pytest.approx(held.position_ned_m, abs=0.05)


def test_a_hold_command_ends_it_for_good() -> None:
    bench = airborne()
    bench.engage()
    bench.command(SET_MODE, *PX4_HOLD)
    bench.run(3.0)  # setpoints go on, the intended mode is HOLD
    assert bench.vehicle.autopilot.mode is Mode.HOLD
    assert bench.newest("CURRENT_MODE").intended_custom_mode == PX4_NUMBERS[Mode.HOLD]


@pytest.mark.parametrize(("rate_hz", "entries"), [(20.0, 0), (1.1, 0), (0.5, 2)])
def test_how_slow_a_stream_may_be(rate_hz: float, entries: int) -> None:
    bench = airborne()
    bench.engage()
    bench.setpoint_hz = rate_hz
    bench.run(10.0)
    failsafes = bench.texts().count("Failsafe activated\t")
    assert failsafes == 0 if entries == 0 else failsafes >= entries


def test_the_pilot_changes_mode_and_setpoints_are_ignored() -> None:
    bench = airborne()
    bench.engage()
    changed_s = bench.now_s
    bench.vehicle.pilot_sets_mode(Mode.POSITION)
    bench.run(4.0)
    assert not bench.of("COMMAND_ACK", changed_s)
    assert not bench.texts(changed_s)
    assert bench.vehicle.autopilot.mode is Mode.POSITION
    assert bench.vehicle.pose().velocity_ned_mps == pytest.approx((0.0, 0.0, 0.0), abs=0.05)
    assert bench.newest("HEARTBEAT").base_mode == 0xD1
    assert bench.command(SET_MODE, *PX4_OFFBOARD) == 0


@pytest.mark.parametrize(("override", "taken"), [(1, False), (3, True)])
def test_sticks_take_over_only_where_the_parameter_says_so(override: int, taken: bool) -> None:
    bench = airborne(COM_RC_OVERRIDE=override)
    bench.engage()
    assert bench.vehicle.autopilot.pilot_moves_sticks() is taken  # type: ignore[attr-defined]
    bench.run(0.1)
    assert (bench.vehicle.autopilot.mode is Mode.POSITION) is taken
    assert ("Pilot took over using sticks\t" in bench.texts()) is taken


@pytest.mark.parametrize(("action", "mode"), [(0, Mode.EXTERNAL), (1, Mode.HOLD), (2, Mode.HOLD)])
def test_lost_station_heartbeats(action: int, mode: Mode) -> None:
    bench = airborne(NAV_DLL_ACT=action)
    bench.heartbeats = True
    bench.engage(0.5)
    bench.run(2.0)
    bench.heartbeats = False
    bench.run(10.5)
    assert bench.vehicle.autopilot.mode is Mode.EXTERNAL
    bench.run(2.0)
    assert bench.vehicle.autopilot.mode is mode
    if action == 2:
        bench.run(5.0)
        assert bench.vehicle.autopilot.mode is Mode.RETURN
    bench.heartbeats = True
    bench.run(1.2)
    assert bench.vehicle.autopilot.mode is (Mode.RETURN if action == 2 else Mode.EXTERNAL)
    assert "GCS connection regained\t" in bench.texts()


@pytest.mark.parametrize(("action", "mode"), [(1, Mode.EXTERNAL), (2, Mode.HOLD), (3, Mode.HOLD)])
def test_geofence(action: int, mode: Mode) -> None:
    bench = airborne(GF_ACTION=action, GF_MAX_HOR_DIST=10.0)
    bench.engage(3.0)
    bench.run(4.8)
    assert bench.vehicle.autopilot.flight.home_distance_m > 10.0
    assert bench.vehicle.autopilot.mode is mode
    assert bench.command(SET_MODE, *PX4_OFFBOARD) == 0
    bench.run(3.0)
    assert bench.vehicle.autopilot.mode is Mode.EXTERNAL
    assert bench.vehicle.autopilot.flight.home_distance_m > 13.0

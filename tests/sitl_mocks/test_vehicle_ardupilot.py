"""The mock with ArduCopter's personality against what was measured on ArduCopter."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.vehicle import MockVehicle, Mode, Result
from tests.sitl_mocks.vehicle_bench import ARM, LAND, NAN, SET_MODE, TAKEOFF, Bench

GUIDED = (1.0, 4.0)
BRAKE = (1.0, 17.0)


def airborne(**parameters: float) -> Bench:
    bench = Bench(MockVehicle("ardupilot", airborne_m=20.0, parameters=parameters))
    bench.run(0.1)
    return bench


def guided(bench: Bench, speed_mps: float) -> None:
    assert bench.command(SET_MODE, *GUIDED) == 0
    bench.velocity = (speed_mps, 0.0, 0.0, 0.0)


def test_nothing_is_streamed_until_asked() -> None:
    bench = Bench(MockVehicle("ardupilot"))
    bench.run(5.0)
    assert set(bench.count(0.0)) <= {"HEARTBEAT", "TIMESYNC", "STATUSTEXT"}
    assert bench.command(511, 30, 50_000) == 0
    start_s = bench.now_s
    bench.run(2.0)
    assert bench.count(start_s + 1e-6)["ATTITUDE"] == 40
    assert bench.command(511, 30, 0) == 0  # 0 brings the default back: silence
    start_s = bench.now_s
    bench.run(1.0)
    assert not bench.of("ATTITUDE", start_s)


def test_heartbeat_comes_at_once_on_a_mode_change() -> None:
    bench = airborne()
    bench.run(0.4)
    asked_s = bench.now_s
    bench.command(SET_MODE, *GUIDED)
    first_s, heartbeat = bench.of("HEARTBEAT", asked_s)[0]
    assert first_s - asked_s < 0.005
    assert (heartbeat.custom_mode, heartbeat.base_mode, heartbeat.autopilot) == (4, 0xD9, 3)
    assert bench.command(511, 0, 100_000) == 0
    start_s = bench.now_s
    bench.run(2.0)
    assert bench.count(start_s + 1e-6)["HEARTBEAT"] == pytest.approx(20, abs=1)


@pytest.mark.parametrize(
    ("command", "params", "result"),
    [
        (31000, (), Result.UNSUPPORTED),
        (519, (1.0,), Result.UNSUPPORTED),
        (115, (), Result.ACCEPTED),
        (ARM, (2.0,), Result.UNSUPPORTED),
        (ARM, (0.0,), Result.FAILED),
        (TAKEOFF, (), Result.FAILED),
        (SET_MODE, (1.0, 99.0), Result.FAILED),
        (SET_MODE, (0.0, 4.0), Result.DENIED),
        (511, (50000, 1000), Result.DENIED),
        (512, (50000,), Result.FAILED),
        (512, (300,), Result.FAILED),
    ],
)
def test_answers_in_flight(command: int, params: tuple[float, ...], result: Result) -> None:
    bench = airborne()
    assert bench.command(command, *params) == result
    assert bench.vehicle.autopilot.mode is Mode.BRAKE


def test_px4s_offboard_number_means_return_here() -> None:
    bench = airborne()
    assert bench.command(SET_MODE, 129.0, 6.0, 0.0) == 0
    assert bench.vehicle.autopilot.mode is Mode.RETURN


def test_a_component_that_does_not_exist_is_obeyed_another_system_is_not() -> None:
    bench = airborne()
    assert bench.command(SET_MODE, *GUIDED, system=2) is None
    assert bench.command(SET_MODE, *GUIDED, component=50) == 0


def test_arming_fails_with_a_reason_before_it_is_ready() -> None:
    bench = Bench(MockVehicle("ardupilot", ready_after_s=3.0))
    assert bench.command(ARM, 1.0) == Result.FAILED
    assert bench.texts() == ["PreArm: Need Position Estimate"]
    bench.run(3.0)
    assert bench.command(ARM, 1.0) == 0


def test_take_off_needs_guided_and_armed_and_landing_disarms() -> None:
    bench = Bench(MockVehicle("ardupilot", parameters={"LAND_SPEED": 150.0}))
    bench.command(511, 245, 100_000)
    assert bench.command(TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, 3.0) == Result.FAILED
    assert bench.command(SET_MODE, *GUIDED) == 0
    assert bench.command(ARM, 1.0) == 0
    assert bench.newest("HEARTBEAT").system_status == 3
    bench.velocity = (0.0, 0.0, -1.0, 0.0)
    bench.run(2.0)
    assert not bench.vehicle.autopilot.flight.flying  # a climb setpoint does not lift it
    bench.velocity = None
    assert bench.command(TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, 3.0) == 0
    bench.run(7.0)
    assert bench.vehicle.autopilot.flight.height_m == pytest.approx(3.0, abs=0.2)
    assert bench.vehicle.autopilot.mode is Mode.EXTERNAL
    assert bench.newest("HEARTBEAT").system_status == 4
    assert bench.command(LAND) == 0
    bench.run(8.0)
    assert not bench.vehicle.autopilot.armed
    assert bench.vehicle.autopilot.mode is Mode.LAND


def test_lost_setpoints_coast_3_s_then_brake_silently_in_guided() -> None:
    bench = airborne()
    guided(bench, 3.0)
    bench.run(4.0)
    last_s = bench.fall_silent()
    bench.run(2.9)
    assert bench.vehicle.pose().velocity_ned_mps[0] == pytest.approx(3.0, abs=0.05)
    bench.run(0.5)
    assert bench.vehicle.pose().velocity_ned_mps[0] < 2.8
    bench.run(3.0)
    assert bench.vehicle.pose().velocity_ned_mps[0] == pytest.approx(0.0, abs=0.1)
    assert bench.vehicle.autopilot.mode is Mode.EXTERNAL
    assert not bench.texts(last_s)
    assert bench.newest("HEARTBEAT").system_status == 4
    bench.velocity = (2.0, 0.0, 0.0, 0.0)
    bench.run(4.0)
    assert bench.vehicle.pose().velocity_ned_mps[0] == pytest.approx(2.0, abs=0.05)


def test_half_a_setpoint_a_second_is_enough() -> None:
    bench = airborne()
    guided(bench, 2.0)
    bench.setpoint_hz = 0.5
    bench.run(4.0)
    slowest = 9.0
    for _ in range(40):
        bench.run(0.2)
        slowest = min(slowest, bench.vehicle.pose().velocity_ned_mps[0])
    assert slowest > 1.9


def test_brake_holds_and_loiter_with_a_low_throttle_sinks() -> None:
    bench = airborne()
    guided(bench, 3.0)
    bench.run(3.0)
    assert bench.command(SET_MODE, *BRAKE) == 0
    bench.run(5.0)
    height_m = bench.vehicle.autopilot.flight.height_m
    bench.run(3.0)
    assert bench.vehicle.autopilot.flight.height_m == pytest.approx(height_m, abs=0.05)
    assert bench.command(SET_MODE, 1.0, 5.0) == 0
    bench.run(5.0)
    assert bench.vehicle.pose().velocity_ned_mps[2] == pytest.approx(2.5, abs=0.1)


@pytest.mark.parametrize("frame", [1, 7, 8, 9])
def test_four_frames_work(frame: int) -> None:
    bench = Bench(MockVehicle("ardupilot", airborne_m=20.0, yaw_rad=math.pi / 2))
    bench.run(0.1)
    bench.frame = frame
    guided(bench, 2.0)
    bench.run(5.0)
    north, east, _ = bench.vehicle.pose().velocity_ned_mps
    assert (north, east) == pytest.approx((2.0, 0.0) if frame in (1, 7) else (0.0, 2.0), abs=0.05)


def test_bad_setpoints_are_ignored_without_a_word() -> None:
    bench = airborne()
    guided(bench, 2.0)
    bench.run(4.0)
    bench.velocity = None
    texts = len(bench.texts())
    for frame, mask, vx in ((12, 1479, 1.0), (0, 1479, 1.0), (6, 1479, 1.0), (1, 1479, NAN), (1, 0xFFF, 1.0)):
        before = bench.vehicle.autopilot.flight.setpoint
        bench.setpoint(vx, 5.0, 0.0, 0.0, mask=mask, frame=frame)
        assert bench.vehicle.autopilot.flight.setpoint is before
    assert len(bench.texts()) == texts


@pytest.mark.parametrize(("enable", "mode"), [(0, Mode.EXTERNAL), (1, Mode.RETURN), (5, Mode.LAND)])
def test_gcs_failsafe_counts_only_its_own_station(enable: int, mode: Mode) -> None:
    bench = airborne(FS_GCS_ENABLE=enable, MAV_GCS_SYSID=245)
    bench.heartbeats = True
    guided(bench, 0.5)
    bench.run(6.0)
    assert bench.vehicle.autopilot.mode is Mode.EXTERNAL
    bench.heartbeats = False
    bench.run(6.0)
    assert bench.vehicle.autopilot.mode is mode
    assert (bench.newest("HEARTBEAT").system_status == 5) is (enable != 0)
    bench.heartbeats = True
    bench.run(1.5)
    assert bench.vehicle.autopilot.mode is mode
    assert ("GCS Failsafe Cleared" in bench.texts()) is (enable != 0)


def test_heartbeats_of_another_station_do_not_feed_the_failsafe() -> None:
    bench = airborne(FS_GCS_ENABLE=1, MAV_GCS_SYSID=255)
    bench.heartbeats = True  # of system 245
    guided(bench, 0.5)
    bench.run(8.0)
    assert bench.vehicle.autopilot.gcs_heartbeat_t_s is None


def test_fence_returns_but_does_not_stop_a_new_guided() -> None:
    bench = airborne(FENCE_ENABLE=1, FENCE_RADIUS=6.0)
    guided(bench, 3.0)
    bench.run(4.0)
    assert bench.vehicle.autopilot.mode is Mode.RETURN
    assert "Circle fence breached" in bench.texts()
    guided(bench, 3.0)
    bench.run(2.0)
    assert bench.vehicle.autopilot.mode is Mode.EXTERNAL


def test_integer_parameters_are_plain_floats() -> None:
    bench = Bench(MockVehicle("ardupilot"))
    bench.send(mavlink.MAVLink_param_set_message(1, 1, b"FS_GCS_ENABLE", 5.0, 2))
    bench.run(0.05)
    assert bench.newest("PARAM_VALUE").param_value == 5.0
    assert bench.vehicle.params["FS_GCS_ENABLE"] == 5.0

"""The mock with PX4's personality against what was measured on PX4."""

from __future__ import annotations

import itertools
import math
import struct

import pytest
from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.vehicle import MockVehicle, Mode, Result
from sitl_mocks.vehicle.modes import PX4_NUMBERS
from tests.sitl_mocks.vehicle_bench import ARM, LAND, NAN, PX4_HOLD, PX4_OFFBOARD, SET_MODE, TAKEOFF, Bench


def airborne(**parameters: float) -> Bench:
    bench = Bench(MockVehicle(airborne_m=20.0, parameters=parameters))
    bench.run(0.1)
    return bench


def test_streams_have_the_rates_of_the_api_link() -> None:
    bench = Bench(MockVehicle())
    bench.run(1.0)
    start_s = bench.now_s
    bench.run(10.0)
    count = bench.count(start_s + 1e-6)
    expected = {
        "ATTITUDE": 1000, "ATTITUDE_QUATERNION": 500, "GLOBAL_POSITION_INT": 500, "LOCAL_POSITION_NED": 300,
        "ODOMETRY": 300, "POSITION_TARGET_LOCAL_NED": 100, "VFR_HUD": 100, "GPS_RAW_INT": 80, "SYS_STATUS": 50,
        "EXTENDED_SYS_STATE": 50, "HEARTBEAT": 10, "BATTERY_STATUS": 5, "CURRENT_MODE": 5, "HOME_POSITION": 5,
    }  # fmt: skip
    for name, number in expected.items():
        assert count[name] == pytest.approx(number, abs=1), name


def test_heartbeat_stays_at_1_hz_through_mode_changes_and_requests() -> None:
    bench = airborne()
    assert bench.command(511, 0, 100_000) == Result.FAILED
    for _ in range(20):
        bench.run(0.17)
        bench.engage()
        assert bench.command(SET_MODE, *PX4_HOLD) == 0
    times = [t for t, _ in bench.of("HEARTBEAT")]
    assert len(times) > 5
    assert [b - a for a, b in itertools.pairwise(times)] == pytest.approx([1.0] * (len(times) - 1), abs=0.006)


def test_current_mode_at_50_hz_shows_a_change_within_30_ms() -> None:
    bench = airborne()
    assert bench.command(511, 436, 20_000) == 0
    bench.velocity = (1.0, 0.0, 0.0, 0.0)
    bench.run(0.2)
    asked_s = bench.now_s
    bench.command(SET_MODE, *PX4_OFFBOARD)
    changed = [t for t, m in bench.of("CURRENT_MODE", asked_s) if m.custom_mode == PX4_NUMBERS[Mode.EXTERNAL]]
    assert 0.0 <= changed[0] - asked_s <= 0.03


def test_acks_take_1_to_25_ms_and_go_to_the_sender() -> None:
    bench = airborne()
    for _ in range(50):
        sent_s = bench.now_s
        assert bench.command(SET_MODE, *PX4_HOLD) == 0
        arrived_s, ack = bench.of("COMMAND_ACK", sent_s)[-1]
        assert 0.001 <= arrived_s - sent_s <= 0.0301
        assert (ack.target_system, ack.target_component) == (245, 190)


def test_requested_message_comes_before_its_ack() -> None:
    bench = Bench(MockVehicle())
    assert bench.command(512, 148) == 0
    kinds = [m.get_type() for _, m in bench.inbox if m.get_type() in ("AUTOPILOT_VERSION", "COMMAND_ACK")]
    assert kinds == ["AUTOPILOT_VERSION", "COMMAND_ACK"]
    assert bench.newest("AUTOPILOT_VERSION").capabilities == 59647


@pytest.mark.parametrize(
    ("command", "params", "result"),
    [
        (31000, (), Result.UNSUPPORTED),
        (115, (), Result.UNSUPPORTED),
        (519, (1.0,), Result.ACCEPTED),
        (511, (50000, 1000), Result.FAILED),
        (511, (436, -1), Result.ACCEPTED),
        (512, (50000,), Result.DENIED),
        (512, (300,), Result.ACCEPTED),
        (300, (), Result.DENIED),
        (SET_MODE, (129.0, 9.0, 0.0), Result.ACCEPTED),
        (SET_MODE, (0.0, 6.0, 0.0), Result.ACCEPTED),
        (SET_MODE, (129.0, 4.0, 77.0), Result.TEMPORARILY_REJECTED),
        (SET_MODE, PX4_OFFBOARD, Result.TEMPORARILY_REJECTED),
        (SET_MODE, (129.0, 3.0, 0.0), Result.TEMPORARILY_REJECTED),
        (ARM, (0.0,), Result.TEMPORARILY_REJECTED),
        (ARM, (2.0,), None),
    ],
)
def test_answers_in_flight(command: int, params: tuple[float, ...], result: Result | None) -> None:
    bench = airborne()
    assert bench.command(command, *params) == result
    assert bench.vehicle.autopilot.mode is Mode.HOLD
    assert bench.vehicle.autopilot.armed


def test_other_system_or_component_gets_no_answer() -> None:
    bench = airborne()
    assert bench.command(SET_MODE, *PX4_HOLD, system=2) is None
    assert bench.command(SET_MODE, *PX4_HOLD, component=50) is None
    assert bench.command(SET_MODE, *PX4_HOLD, system=0, component=0) == 0


def test_arming_before_ready_is_refused_with_a_chunked_text() -> None:
    bench = Bench(MockVehicle(ready_after_s=4.0))
    assert bench.command(ARM, 1.0) == Result.TEMPORARILY_REJECTED
    assert bench.newest("HEARTBEAT").system_status == 0
    chunks = [m for _, m in bench.of("STATUSTEXT")]
    assert "".join(m.text for m in chunks) == "Arming denied: Resolve system health failures first\t"
    assert [m.chunk_seq for m in chunks] == [0, 1]
    assert chunks[0].id == chunks[1].id != 0
    bench.run(4.0)
    assert bench.command(ARM, 1.0) == Result.ACCEPTED


def test_take_off_land_and_disarm() -> None:
    bench = Bench(MockVehicle(parameters={"MIS_TAKEOFF_ALT": 3.0, "MPC_TKO_SPEED": 3.0}))
    assert bench.command(TAKEOFF) == 0
    bench.run(1.0)
    assert not bench.vehicle.autopilot.flight.flying
    assert bench.command(ARM, 1.0) == 0
    bench.run(5.0)
    assert bench.vehicle.autopilot.mode is Mode.HOLD
    assert bench.newest("GLOBAL_POSITION_INT").relative_alt == pytest.approx(3000, abs=200)
    assert bench.newest("EXTENDED_SYS_STATE").landed_state == 2
    assert bench.newest("HEARTBEAT").base_mode == 0x9D
    bench.command(LAND)
    bench.run(1.0)
    assert bench.newest("EXTENDED_SYS_STATE").landed_state == 4
    bench.run(5.0)
    landed_s = next(t for t, m in bench.of("EXTENDED_SYS_STATE", bench.now_s - 5) if m.landed_state == 1)
    assert bench.vehicle.autopilot.armed
    bench.run(3.0)
    assert not bench.vehicle.autopilot.armed
    first_disarmed_s = next(t for t, m in bench.of("HEARTBEAT", landed_s) if not m.base_mode & 0x80)
    assert 1.9 <= first_disarmed_s - landed_s <= 3.2
    assert bench.vehicle.autopilot.mode is Mode.HOLD


def test_armed_without_take_off_disarms_after_10_s() -> None:
    bench = Bench(MockVehicle())
    bench.command(ARM, 1.0)
    bench.run(9.8)
    assert bench.vehicle.autopilot.armed
    bench.run(0.3)
    assert not bench.vehicle.autopilot.armed


def test_offboard_arming_needs_setpoints_and_a_climb_takes_off() -> None:
    bench = Bench(MockVehicle())
    assert bench.command(SET_MODE, *PX4_OFFBOARD) == 0
    assert bench.command(ARM, 1.0) == Result.TEMPORARILY_REJECTED
    bench.velocity = (0.0, 0.0, -1.0, 0.0)
    bench.run(0.1)
    assert bench.command(ARM, 1.0) == 0
    bench.run(4.0)
    assert bench.vehicle.autopilot.flight.height_m > 1.0


@pytest.mark.parametrize("frame", [6, 7, 9])
def test_other_frames_are_refused_and_offboard_is_lost(frame: int) -> None:
    bench = airborne()
    bench.engage()
    bench.frame = frame
    bench.run(1.3)
    assert f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {frame} unsupported\t" in bench.texts()
    assert bench.vehicle.autopilot.mode is Mode.POSITION


def test_a_mask_that_ignores_everything_is_invalid() -> None:
    bench = airborne()
    bench.setpoint(1, 0, 0, 0, mask=0xFFF)
    bench.run(0.01)
    assert bench.texts() == ["SET_POSITION_TARGET_LOCAL_NED invalid\t"]
    assert bench.vehicle.autopilot.setpoint_t_s is None


def test_nan_in_the_body_frame_leaves_the_horizontal_axes_adrift() -> None:
    bench = airborne()
    bench.engage(3.0)
    bench.run(4.0)
    bench.frame = 8
    bench.velocity = (NAN, 0.0, 0.0, 0.0)
    bench.run(2.0)
    assert bench.vehicle.autopilot.mode is Mode.EXTERNAL
    assert 1.5 < bench.vehicle.pose().velocity_ned_mps[0] < 2.5
    echo = bench.newest("POSITION_TARGET_LOCAL_NED")
    assert math.isnan(echo.vx)


def test_body_frame_turns_with_the_heading_and_is_echoed_in_ned() -> None:
    bench = Bench(MockVehicle(airborne_m=20.0, yaw_rad=math.pi / 2))
    bench.frame = 8
    bench.engage(2.0)
    bench.run(4.0)
    assert bench.vehicle.pose().velocity_ned_mps == pytest.approx((0.0, 2.0, 0.0), abs=0.05)
    echo = bench.newest("POSITION_TARGET_LOCAL_NED")
    assert (echo.coordinate_frame, echo.vx, echo.vy) == (1, pytest.approx(0, abs=1e-6), pytest.approx(2.0))


def test_setpoints_for_another_system_are_ignored() -> None:
    bench = airborne()
    bench.setpoint(1, 0, 0, 0, system=7)
    assert bench.vehicle.autopilot.setpoint_t_s is None


def test_parameters_read_set_and_list_with_integers_bytewise() -> None:
    bench = Bench(MockVehicle())
    bench.send(mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OBL_RC_ACT", -1))
    bench.run(0.05)
    value = bench.newest("PARAM_VALUE")
    assert value.param_type == 6
    assert struct.pack("<f", value.param_value) == struct.pack("<i", 0)
    five = struct.unpack("<f", struct.pack("<i", 5))[0]
    bench.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OBL_RC_ACT", five, 6))
    bench.run(0.05)
    assert bench.vehicle.params["COM_OBL_RC_ACT"] == 5.0
    assert struct.pack("<f", bench.newest("PARAM_VALUE").param_value) == struct.pack("<i", 5)
    before = bench.now_s
    bench.send(mavlink.MAVLink_param_request_list_message(1, 1))
    bench.run(0.2)
    listed = [m.param_id for _, m in bench.of("PARAM_VALUE", before)]
    assert listed == bench.vehicle.params.names()
    bench.send(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH_PARAM", -1))
    before = bench.now_s
    bench.run(0.2)
    assert not bench.of("PARAM_VALUE", before + 1e-6)


def test_unknown_names_are_refused_in_one_line() -> None:
    with pytest.raises(ValueError, match="NOPE"):
        MockVehicle(parameters={"NOPE": 1.0})
    with pytest.raises(ValueError, match="betaflight"):
        MockVehicle("betaflight")
    with pytest.raises(ValueError, match="airborne_m"):
        MockVehicle(airborne_m=0.0)

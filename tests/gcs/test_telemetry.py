"""Telemetry and its stream requests, on a fake clock and without a socket."""

from __future__ import annotations

import asyncio

import pytest
from pymavlink.dialects.v20 import development as mav

from control.types import VehicleMode
from gcs.autopilot.px4 import Px4
from gcs.errors import VehicleError
from gcs.telemetry import LINK_LOST_S
from tests.gcs.recording_wire import ack
from tests.gcs.wire_peer import PX4_OFFBOARD, PX4_POSCTL, heartbeat


def attitude(boot_ms=1000, roll=0.1):
    return mav.MAVLink_attitude_message(boot_ms, roll, 0.0, 0.5, 0.0, 0.0, 0.0)


def local(x=1.0):
    return mav.MAVLink_local_position_ned_message(1, x, 0.0, -5.0, 0.0, 0.0, 0.0)


def height(mm=5000):
    return mav.MAVLink_global_position_int_message(1, 0, 0, 0, mm, 0, 0, 0, 0)


def test_position_is_as_old_as_the_older_of_position_and_height(wire, telemetry):
    wire.hear(local(), 1.0)
    assert telemetry.vehicle_state().position_t_s is None
    wire.hear(height(), 2.0)
    assert telemetry.vehicle_state().position_t_s == 1.0
    wire.hear(local(), 3.0)
    assert telemetry.vehicle_state().position_t_s == 2.0
    wire.hear(local(x=float("nan")), 4.0)
    wire.hear(height(), 4.0)
    assert telemetry.vehicle_state().position_t_s == 3.0


def test_attitude_history_can_be_asked_between_samples(wire, telemetry):
    wire.hear(attitude(1000, 0.0), 1.00)
    wire.hear(attitude(1020, 0.2), 1.02)
    assert telemetry.attitude.at(1.01)[0] == pytest.approx(0.1)
    wire.hear(attitude(1040, float("nan")), 1.04)
    assert telemetry.attitude.at(1.02)[0] == pytest.approx(0.2)


def test_attitude_is_dated_back_by_the_way_over_the_link(wire, telemetry):
    """So that it is of one clock with the pictures; its freshness still counts from its arrival."""
    stamp_ns = telemetry.round_trip.ask(1.0)
    wire.hear(mav.MAVLink_timesync_message(5, stamp_ns), 1.08)
    wire.hear(attitude(), 2.0)
    assert telemetry.attitude.newest_t_s == pytest.approx(1.96)
    assert telemetry.vehicle_state().attitude_t_s == 2.0


def test_intended_mode_prearm_home_and_echo(wire, telemetry):
    assert telemetry.prearm_ok is None
    wire.hear(mav.MAVLink_current_mode_message(0, PX4_POSCTL, PX4_OFFBOARD), 1.0)
    for healthy, expected in ((0x10000000, True), (0, False)):
        sensors = 0x10000000
        wire.hear(mav.MAVLink_sys_status_message(sensors, sensors, healthy, 0, 0, 0, 50, 0, 0, 0, 0, 0, 0), 1.0)
        assert telemetry.prearm_ok is expected
    wire.hear(mav.MAVLink_home_position_message(473977420, 85455940, 488000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0), 1.0)
    echo = mav.MAVLink_position_target_local_ned_message(1, 1, 0x5C7, 0, 0, 0, 1.5, 0, 0, 0, 0, 0, 0, 0)
    wire.hear(echo, 2.0)
    assert telemetry.vehicle_state().mode is VehicleMode.MANUAL
    assert telemetry.intended_mode is VehicleMode.EXTERNAL
    assert telemetry.home.latitude_deg == pytest.approx(47.397742)
    assert (telemetry.setpoint_echo.t_s, telemetry.setpoint_echo.velocity_ned_mps) == (2.0, (1.5, 0.0, 0.0))


def test_foreign_stations_are_noticed_and_other_vehicles_ignored(wire, telemetry):
    station = mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    wire.hear(station, 1.0, 250, 190)
    wire.hear(station, 2.0, 255, 191)  # an echo of our own
    wire.hear(heartbeat(), 3.0, 2, 1)
    assert telemetry.foreign_stations == {(250, 190): 1.0}
    assert telemetry.vehicle_state().heartbeat_t_s is None


def test_answers_to_others_are_not_ours(wire, telemetry):
    wire.hear(ack(176, 4, 245, 190), 1.0)
    assert telemetry.ack_since(0.0, 176) is None
    wire.hear(ack(176, 1), 2.0)
    assert telemetry.ack_since(0.0, 176).result_name == "TEMPORARILY_REJECTED"
    assert telemetry.ack_since(2.5, 176) is None
    wire.hear(ack(400, 99), 3.0)
    assert telemetry.ack_since(0.0, 400).result_name == "result 99"
    assert telemetry.foreign_stations == {}  # 245/190 is our own MAVSDK


def test_an_answer_to_another_station_shows_that_it_commands_the_vehicle(wire, telemetry):
    wire.hear(ack(176, 0, 255, 190), 1.0)
    wire.hear(ack(176, 0, 255, 190), 2.0)
    assert telemetry.foreign_stations == {(255, 190): 2.0}
    for system in range(1, 40):  # no more are kept than can be needed, and the known ones stay up to date
        wire.hear(ack(176, 0, system, 1), 3.0)
    wire.hear(ack(176, 0, 255, 190), 4.0)
    assert len(telemetry.foreign_stations) == 16
    assert telemetry.foreign_stations[255, 190] == 4.0


def test_streams_are_asked_for_on_connect_and_after_a_reconnect(wire, telemetry, clock):
    assert telemetry.ask(100.0) == 0  # nobody there
    wire.hear(heartbeat(), 100.0)
    wanted = {(stream.message_id, round(1e6 / stream.rate_hz)) for stream in Px4().streams}
    assert telemetry.ask(100.0) == len(wanted)
    assert {(m.param1, m.param2) for m in wire.sent} == wanted
    assert {m.command for m in wire.sent} == {511}
    assert telemetry.ask(100.5) == 0
    assert telemetry.ask(101.1) == len(wanted)  # none flows: asked again
    assert telemetry.ask(100.0 + LINK_LOST_S + 0.1) == 0  # gone: nothing to ask
    wire.hear(heartbeat(), 110.0)
    assert telemetry.reconnects == 1
    assert telemetry.ask(110.0) == len(wanted)
    assert "CURRENT_MODE" in telemetry.missing_streams(110.0)


def test_streams_are_asked_for_again_after_a_reboot(wire, telemetry):
    wire.hear(heartbeat(), 100.0)
    telemetry.ask(100.0)
    wire.hear(attitude(boot_ms=60_000), 100.1)
    wire.hear(attitude(boot_ms=59_990), 100.2)  # overtaken on the way, no reboot
    assert telemetry.reconnects == 0
    wire.hear(attitude(boot_ms=200), 100.5)
    assert telemetry.reconnects == 1
    assert telemetry.ask(100.5) == len(Px4().streams)


async def test_wait_for_is_woken_by_the_message_and_gives_up(wire, telemetry):
    waiting = asyncio.create_task(telemetry.wait_for(lambda s: s.armed, 5.0))
    await asyncio.sleep(0)
    wire.hear(heartbeat(base_mode=0x1D), 1.0)
    await asyncio.sleep(0)
    assert not waiting.done()
    wire.hear(heartbeat(base_mode=0x9D), 2.0)
    assert await waiting is True
    assert await telemetry.wait_for(lambda s: s.in_air, 0.01) is False
    assert telemetry._waiting == []


def test_no_vehicle_yet_is_a_clear_error(wire, telemetry):
    wire.vehicle = None
    with pytest.raises(VehicleError, match="no vehicle has been heard"):
        _ = telemetry.vehicle
    assert telemetry.vehicle_state().mode is VehicleMode.UNKNOWN


def test_positions_are_counted_from_home(wire, telemetry):
    wire.hear(mav.MAVLink_home_position_message(470000000, 80000000, 400000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0), 1.0)
    wire.hear(local(x=25.0), 1.0)
    assert telemetry.vehicle_state().position_ned_m == (25.0, 0.0, -5.0)
    wire.hear(mav.MAVLink_global_position_int_message(1, 470000000, 80000000, 0, 0, 0, 0, 0, 0), 1.0)
    assert telemetry.vehicle_state().position_ned_m == (0.0, 0.0, -5.0)
    assert telemetry.home_frame.home == telemetry.home

"""The whole way: MAVSDK by raw:// and our own setpoints on one wire, over real UDP to the mock vehicle."""

from __future__ import annotations

import asyncio
import math
import time

import pytest
from pymavlink.dialects.v20 import development as mav

from control.gate import Reason
from control.types import VehicleMode
from gcs.autopilot.mavsdk_link import MavsdkLink
from gcs.errors import VehicleError
from sitl_mocks.vehicle import Mode, Result
from tests.gcs.vehicle_session import BOTH, CLOCK, session
from tests.gcs.wire_peer import eventually


@BOTH
async def test_a_flight_from_arming_to_landing(personality):
    async with session(personality) as s:
        await s.actions.wait_ready(20.0)
        await s.actions.arm()
        assert s.mock.autopilot.armed
        await s.actions.takeoff(3.0)
        assert s.mock.pose().position_ned_m[2] < -2.5
        await s.actions.hold()
        await s.reached(VehicleMode.HOLD)

        s.start_stream()
        await asyncio.sleep(0.3)  # PX4 wants setpoints before the mode
        await s.modes.enter_external()
        assert s.mock.autopilot.mode is Mode.EXTERNAL
        s.velocity = (1.5, 0.0, 0.0)
        assert await s.telemetry.wait_for(lambda st: st.velocity_ned_mps[0] > 1.2, 6.0), s.reasons
        assert s.mock.pose().velocity_ned_mps[0] > 1.0
        echo = await eventually(lambda: s.telemetry.setpoint_echo)
        assert echo.velocity_ned_mps[0] > 0.0
        moved = s.setpoints_from(0.0)
        assert {(m.get_srcSystem(), m.get_srcComponent()) for m in moved} == {(255, 191)}
        assert {(m.coordinate_frame, m.type_mask) for m in moved} == {(1, 0x5C7)}

        s.mock.autopilot.pilot_sets_mode(Mode.POSITION)
        await s.reached(VehicleMode.MANUAL)
        t_seen_s = time.monotonic()
        await asyncio.sleep(0.3)
        assert len(s.setpoints_from(t_seen_s + 0.06)) == 0
        assert Reason.NOT_OURS in s.reasons
        assert s.mock.autopilot.mode is Mode.POSITION
        await s.stop_stream()

        await s.actions.hold()
        await s.actions.land()
        await s.reached(VehicleMode.LAND)
        assert await s.telemetry.wait_for(lambda st: not st.armed, 30.0)
        assert s.wire.counters.refused == 0


@BOTH
async def test_hold_ends_external_control(personality):
    async with session(personality, airborne_m=10.0) as s:
        await s.telemetry.wait_for(lambda st: st.position_t_s is not None, 5.0)
        s.start_stream()
        await asyncio.sleep(0.3)
        await s.modes.enter_external()
        assert await s.modes.hold() is VehicleMode.HOLD
        assert s.mock.autopilot.mode is (Mode.HOLD if personality == "px4" else Mode.BRAKE)
        await s.stop_stream()
        await s.actions.return_to_launch()
        await s.reached(VehicleMode.RETURN)


@BOTH
async def test_every_stream_flows_because_it_was_asked_for(personality):
    async with session(personality, rates_hz={mav.MAVLINK_MSG_ID_HEARTBEAT: 1.0}) as s:
        await eventually(lambda: not s.telemetry.missing_streams(CLOCK.now_s()), 15.0)
        state = s.telemetry.vehicle_state()
        assert state.attitude_t_s is not None
        assert state.battery_frac is not None
        assert s.telemetry.home is not None
        assert s.telemetry.attitude.at(CLOCK.now_s() - 0.1) is not None


async def test_streams_are_asked_for_again_after_the_vehicle_was_away():
    async with session("ardupilot", rates_hz={mav.MAVLINK_MSG_ID_HEARTBEAT: 5.0}) as s:
        attitude = mav.MAVLINK_MSG_ID_ATTITUDE
        await eventually(lambda: s.telemetry.vehicle_state().attitude_t_s)
        s.mock.faults.drop_downlink = 1.0
        await asyncio.sleep(3.3)
        s.mock.streams.set_interval(attitude, -1, time.monotonic())  # as after its reboot
        s.mock.faults.drop_downlink = 0.0
        t_back_s = time.monotonic()
        await eventually(lambda: (s.telemetry.vehicle_state().attitude_t_s or 0.0) > t_back_s + 0.2)
        assert s.telemetry.reconnects == 1


async def test_parameters_keep_their_types():
    async with session("px4") as s:
        assert await s.actions.get_param("COM_OF_LOSS_T") == pytest.approx(1.0)
        assert await s.actions.get_param("COM_OBL_RC_ACT") == 0
        await s.actions.set_param("COM_OBL_RC_ACT", 5)
        assert s.mock.params["COM_OBL_RC_ACT"] == 5
        assert isinstance(await s.actions.get_param("COM_OBL_RC_ACT"), int)
        with pytest.raises(VehicleError, match="is an integer"):
            await s.actions.set_param("COM_OBL_RC_ACT", 0.5)
        with pytest.raises(VehicleError, match="NO_SUCH: TIMEOUT"):
            await s.actions.get_param("NO_SUCH")


@BOTH
async def test_refused_arming_gives_the_vehicles_reason(personality):
    async with session(personality, ready_after_s=math.inf) as s:
        with pytest.raises(VehicleError, match=r"refused “arm”: .*, “.+”"):
            await s.actions.arm()
        with pytest.raises(VehicleError, match=r"not ready within 0.5 s: .*pre-arm checks fail"):
            await s.actions.wait_ready(0.5)


@BOTH
async def test_refused_external_control_gives_answer_and_reason(personality):
    async with session(personality, airborne_m=10.0) as s:
        await s.telemetry.wait_for(lambda st: st.armed and st.mode is VehicleMode.HOLD, 5.0)
        result = Result.TEMPORARILY_REJECTED if personality == "px4" else Result.FAILED
        s.mock.faults.refuse[176] = result
        with pytest.raises(VehicleError, match=f"{result.name}.*its mode is hold"):
            await s.modes.enter_external()
        s.mock.faults.refuse[176] = None
        with pytest.raises(VehicleError, match=r"no answer, .*its mode is hold"):
            await s.modes.enter_external()
        s.mock.faults.refuse[176] = Result.ACCEPTED  # and nothing happens
        with pytest.raises(VehicleError, match=r"ACCEPTED, .*its mode is hold"):
            await s.modes.enter_external()
        commands = [m for _, m in s.arrived if m.get_type() == "COMMAND_LONG" and m.command == 176]
        assert len(commands) == 3  # each time asked once


async def test_hold_that_is_not_obeyed_is_repeated_and_reported():
    async with session("px4", airborne_m=10.0) as s:
        await s.telemetry.wait_for(lambda st: st.position_t_s is not None, 5.0)
        s.start_stream()
        await asyncio.sleep(0.3)
        await s.modes.enter_external()
        t_s = time.monotonic()
        s.mock.faults.refuse[176] = Result.ACCEPTED
        with pytest.raises(VehicleError, match=r"does not hold: ACCEPTED, .*its mode is external"):
            await s.modes.hold()
        await s.stop_stream()
        commands = [m for t, m in s.arrived if t >= t_s and m.get_type() == "COMMAND_LONG" and m.command == 176]
        assert [m.confirmation for m in commands] == [0, 1, 2]


async def test_wait_ready_and_attach_say_what_is_missing():
    async with session("px4") as s:
        s.mock.faults.drop_downlink = 1.0
        second = MavsdkLink(s.wire, CLOCK)
        with pytest.raises(VehicleError, match="MAVSDK found no autopilot"):
            await second.system(0.2)
        await second.close()
        s.mock.faults.refuse[22] = Result.DENIED
        s.mock.faults.drop_downlink = 0.0
        await s.actions.wait_ready(20.0)
        await s.actions.arm()
        with pytest.raises(VehicleError, match="refused “take off”: COMMAND_DENIED"):
            await s.actions.takeoff(3.0)


async def test_takeoff_height_must_make_sense():
    async with session("px4") as s:
        for height_m in (0.0, math.nan, 1e6):
            with pytest.raises(VehicleError, match="height"):
                await s.actions.takeoff(height_m)

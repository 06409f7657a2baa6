"""Framing and codec: round trips, garbage of every kind, what a mode number means."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mav

from control.types import VehicleMode, VehicleState
from gcs import codec
from gcs.autopilot.ardupilot import ArduCopter
from gcs.autopilot.px4 import Px4
from gcs.codec import VehicleId
from gcs.framing import CodecError, Deframer, Encoder, split_frames
from tests.gcs.wire_peer import heartbeat, setpoint

VEHICLE = VehicleId(1, 1, Px4())


def frames(*messages, system_id=1, component_id=1):
    encoder = Encoder(system_id, component_id)
    return [encoder.encode(message) for message in messages]


def decoded(message, system_id=1, component_id=1):
    (out,) = Deframer().datagram(frames(message, system_id=system_id, component_id=component_id)[0])
    return out


def attitude(yaw=0.5, boot_ms=1000):
    return mav.MAVLink_attitude_message(boot_ms, 0.1, -0.2, yaw, 0.0, 0.0, 0.3)


def test_setpoint_is_velocity_and_yaw_rate_in_local_ned():
    value = setpoint(10.0)
    message = decoded(codec.setpoint(value, VEHICLE, 1234), 255, 191)
    assert message.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
    assert (message.target_system, message.target_component) == (1, 1)
    assert (message.coordinate_frame, message.type_mask) == (1, 0x5C7)
    assert (message.vx, message.vy, message.vz) == pytest.approx(value.velocity_ned_mps)
    assert message.vx != 0.0
    assert message.yaw_rate == pytest.approx(value.yaw_rate_rps)
    assert message.yaw_rate != 0.0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_setpoint_that_is_not_finite_is_refused(bad):
    value = setpoint(10.0)
    object.__setattr__(value, "velocity_ned_mps", (0.0, bad, 0.0))
    with pytest.raises(CodecError, match="not finite"):
        codec.setpoint(value, VEHICLE, 0)


def test_sequence_numbers_advance_and_wrap_in_mavlink_2():
    encoder = Encoder(255, 191)
    sent = [encoder.encode(codec.heartbeat()) for _ in range(258)]
    assert {frame[0] for frame in sent} == {0xFD}
    assert [frame[4] for frame in sent] == [n % 256 for n in range(258)]
    assert all((frame[5], frame[6]) == (255, 191) for frame in sent)


def test_field_out_of_range_is_one_clear_error_and_costs_no_sequence_number():
    encoder = Encoder(255, 191)
    with pytest.raises(CodecError, match="HEARTBEAT"):
        encoder.encode(mav.MAVLink_heartbeat_message(300, 8, 0, 0, 4, 3))
    assert encoder.encode(codec.heartbeat())[4] == 0


def test_garbage_that_looks_like_a_long_frame_swallows_nothing():
    # Measured on pymavlink's own parser: this start swallowed the next ten good frames.
    good = frames(*[heartbeat()] * 12)
    deframer = Deframer()
    seen = deframer.datagram(b"\xfd\xff" + b"\x00" * 20)
    for frame in good:
        seen += deframer.datagram(frame)
    assert len(seen) == 12
    assert deframer.counters.bad >= 1
    assert len(Deframer().datagram(b"\xfd\xff\x00" + b"".join(good))) == 12


def test_unknown_message_is_dropped_and_counted():
    frame = bytearray(frames(heartbeat())[0])
    frame[7:10] = (0xFE, 0xFF, 0xFF)
    deframer = Deframer()
    messages = deframer.datagram(bytes(frame) + frames(heartbeat())[0])
    assert [m.get_type() for m in messages] == ["HEARTBEAT"]
    assert (deframer.counters.bad, deframer.counters.good) == (1, 1)


def test_corrupted_frame_is_dropped_and_counted():
    frame = bytearray(frames(attitude())[0])
    frame[15] ^= 1
    deframer = Deframer()
    assert deframer.datagram(bytes(frame)) == []
    assert deframer.counters.bad >= 1


def test_oversized_datagram_costs_nothing():
    deframer = Deframer()
    assert deframer.datagram(b"\xfd" * 60_000) == []
    assert deframer.counters.bad == 1


garbage = st.binary(max_size=300) | st.lists(st.sampled_from([0xFD, 0xFE, 0, 1, 9, 255]), max_size=60).map(bytes)


@given(st.lists(garbage, max_size=5))
def test_any_garbage_datagrams_then_good_ones(datagrams):
    deframer = Deframer()
    for datagram in datagrams:
        deframer.datagram(datagram)
    for frame in frames(heartbeat(), attitude(), heartbeat()):
        assert len(deframer.datagram(frame)) == 1


@given(garbage, st.integers(min_value=1, max_value=40), st.integers(min_value=0, max_value=255))
def test_any_mutation_of_a_frame_raises_nothing(noise, at, value):
    frame = bytearray(frames(attitude())[0])
    frame[at % len(frame)] = value
    for message in Deframer().datagram(noise + bytes(frame)):
        codec.update(VehicleState(), message, 1.0, VEHICLE)
        codec.identify(message)


@given(st.lists(garbage, max_size=4), st.integers(min_value=1, max_value=9))
def test_stream_in_pieces_gives_the_same_frames(noise, step):
    good = frames(*[attitude(yaw=n / 10) for n in range(5)])
    data = b"".join(part for n, frame in enumerate(good) for part in (noise[n] if n < len(noise) else b"", frame))
    data += b"\x00" * 300  # what comes later lets go of a false start that waits for its end
    deframer, seen = Deframer(), []
    for at in range(0, len(data), step):
        seen += deframer.stream(data[at : at + step])
    assert [round(m.yaw * 10) for m in seen if m.get_type() == "ATTITUDE"][-5:] == [0, 1, 2, 3, 4]


def test_stream_remainder_is_bounded():
    deframer = Deframer()
    for _ in range(500):
        deframer.stream(b"\xfd\xff\x00" + b"\xfd" * 100)
    assert len(deframer._rest) <= 280 + 13


def test_split_frames_sees_through_to_every_frame():
    sent = frames(heartbeat(), attitude())
    assert split_frames(b"".join(sent)) == sent
    assert split_frames(b"".join(sent) + b"x") is None
    assert split_frames(sent[0][:-1]) is None
    assert split_frames(b"") is None


@pytest.mark.parametrize(
    ("main", "sub", "mode"),
    [
        (6, 0, VehicleMode.EXTERNAL),
        (4, 2, VehicleMode.TAKEOFF),
        (4, 3, VehicleMode.HOLD),
        (4, 4, VehicleMode.OTHER),
        (4, 5, VehicleMode.RETURN),
        (4, 6, VehicleMode.LAND),
        (3, 0, VehicleMode.MANUAL),
        (1, 0, VehicleMode.MANUAL),
        (99, 0, VehicleMode.OTHER),
    ],
)
def test_px4_modes(main, sub, mode):
    assert Px4().mode_of(main << 16 | sub << 24) is mode


@pytest.mark.parametrize(
    ("number", "mode"),
    [
        (4, VehicleMode.EXTERNAL),
        (17, VehicleMode.HOLD),
        (5, VehicleMode.HOLD),
        (6, VehicleMode.RETURN),
        (9, VehicleMode.LAND),
        (0, VehicleMode.MANUAL),
        (3, VehicleMode.OTHER),
    ],
)
def test_ardupilot_modes(number, mode):
    assert ArduCopter().mode_of(number) is mode


@pytest.mark.parametrize("autopilot", [Px4(), ArduCopter()])
def test_mode_commands_mean_what_they_say(autopilot):
    for mode in (VehicleMode.EXTERNAL, VehicleMode.HOLD):
        message = codec.set_mode(VehicleId(1, 1, autopilot), mode, armed=True)
        main, sub = int(message.param2), int(message.param3)
        number = main << 16 | sub << 24 if autopilot.name == "PX4" else main
        assert autopilot.mode_of(number) is mode
        assert (message.command, message.param1) == (176, 129)
    with pytest.raises(ValueError, match="never"):
        autopilot.mode_params(VehicleMode.MANUAL)


def test_heartbeat_gives_mode_armed_and_failsafe():
    state = codec.update(VehicleState(), decoded(heartbeat(status=5)), 7.0, VEHICLE)
    assert (state.mode, state.armed, state.failsafe) == (VehicleMode.EXTERNAL, True, True)
    assert (state.heartbeat_t_s, state.mode_t_s) == (7.0, 7.0)


def test_current_mode_is_faster_than_the_heartbeat():
    state = codec.update(VehicleState(), decoded(heartbeat()), 7.0, VEHICLE)
    loiter = mav.MAVLink_current_mode_message(0, 4 << 16 | 3 << 24, 6 << 16)
    state = codec.update(state, decoded(loiter), 7.03, VEHICLE)
    assert (state.mode, state.mode_t_s, state.heartbeat_t_s) == (VehicleMode.HOLD, 7.03, 7.0)


def test_telemetry_values_reach_their_fields():
    state = VehicleState()
    for n, message in enumerate(
        [
            attitude(),
            mav.MAVLink_local_position_ned_message(1, 1.0, 2.0, -3.0, 0.1, 0.2, 0.3),
            mav.MAVLink_global_position_int_message(1, 0, 0, 500_000, 12_345, 0, 0, 0, 0),
            mav.MAVLink_extended_sys_state_message(0, 2),
            mav.MAVLink_battery_status_message(0, 0, 0, 0, [0] * 10, 0, 0, 0, 73),
        ]
    ):
        state = codec.update(state, decoded(message), float(n), VEHICLE)
    assert (state.roll_rad, state.pitch_rad, state.yaw_rad) == pytest.approx((0.1, -0.2, 0.5))
    assert state.yaw_rate_rps == pytest.approx(0.3)
    assert (state.attitude_t_s, state.position_t_s) == (0.0, 1.0)
    assert state.position_ned_m == (1.0, 2.0, -3.0)
    assert state.velocity_ned_mps == pytest.approx((0.1, 0.2, 0.3))
    assert (state.height_m, state.in_air, state.battery_frac) == (12.345, True, 0.73)


def test_not_finite_telemetry_changes_nothing():
    state = replace(VehicleState(), attitude_t_s=1.0, yaw_rad=0.4)
    assert codec.update(state, decoded(attitude(yaw=math.nan)), 2.0, VEHICLE) is state
    position = mav.MAVLink_local_position_ned_message(1, 1.0, math.inf, 0.0, 0.0, 0.0, 0.0)
    assert codec.update(state, decoded(position), 2.0, VEHICLE) is state


def test_another_vehicle_and_another_component_are_ignored():
    state = VehicleState()
    assert codec.update(state, decoded(heartbeat(), system_id=2), 1.0, VEHICLE) is state
    assert codec.update(state, decoded(heartbeat(), component_id=100), 1.0, VEHICLE) is state


def test_only_multicopters_of_known_autopilots_are_vehicles():
    assert codec.identify(decoded(heartbeat())).autopilot.name == "PX4"
    assert codec.identify(decoded(heartbeat(autopilot=3))).autopilot.name == "ArduCopter"
    plane = decoded(mav.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3))
    assert codec.identify(plane) is None
    assert "MAV_TYPE 1" in codec.unusable_reason(plane)
    station = decoded(codec.heartbeat(), 255, 190)
    assert codec.identify(station) is None
    assert codec.unusable_reason(station) is None
    assert codec.is_gcs_heartbeat(station)

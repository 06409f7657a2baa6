"""The judge by itself: each rule fires when it should, and stays quiet when it should not."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.monitor import MonitorLimits, Rule, Truth, WireMonitor
from sitl_mocks.monitor.place import distance_outside_m

GROUND = Truth(external=True, armed=True, in_air=False, position_ned_m=(0.0, 0.0, 0.0))
FLYING = Truth(external=True, armed=True, in_air=True, position_ned_m=(0.0, 0.0, -10.0))
HELD = Truth(external=False, armed=True, in_air=True, position_ned_m=(0.0, 0.0, -10.0))
NAN = math.nan


class Wire:
    """A station's datagrams at 20 Hz on a fake clock; ticks in between."""

    def __init__(self, key: bytes | None = None, **limits: Any) -> None:
        self.monitor = WireMonitor(MonitorLimits(**limits))
        self.now_s = 100.0
        self._packer = mavlink.MAVLink(None, 255, 190)
        if key is not None:
            self._packer.signing.secret_key, self._packer.signing.sign_outgoing = key, True

    def put(self, message: Any, truth: Truth = FLYING) -> None:
        self.monitor.feed(self.now_s, bytes(message.pack(self._packer)), truth)

    def stream(self, vx: float, seconds: float, truth: Truth = FLYING, mask: int = 1479, **other: Any) -> None:
        for _ in range(round(seconds * 20)):
            self.now_s += 0.05
            self.put(
                mavlink.MAVLink_set_position_target_local_ned_message(
                    0, 1, other.get("component", 1), 1, mask, 0, 0, 0, vx, 0, 0, 0, 0, 0, NAN, 0
                ),
                truth,
            )

    def wait(self, seconds: float, truth: Truth = FLYING) -> None:
        for _ in range(round(seconds * 20)):
            self.now_s += 0.05
            self.monitor.tick(self.now_s, truth)

    def command(self, number: int, truth: Truth = FLYING) -> None:
        self.put(mavlink.MAVLink_command_long_message(1, 1, number, 0, *[0.0] * 7), truth)

    @property
    def rules(self) -> dict[Rule, int]:
        return dict(self.monitor.counts)


def test_u1_only_velocities_are_a_follows() -> None:
    wire = Wire()
    wire.stream(0.0, 0.05)
    wire.stream(0.0, 0.05, mask=2503)  # velocity and a heading
    assert not wire.rules
    wire.stream(0.0, 0.05, mask=0xDF8)  # a position
    wire.put(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 0, [1.0, 0.0, 0.0, 0.0], 0, 0, 0, 0.5))
    assert wire.rules == {Rule.OVER_LIMIT: 2}


def test_u2_silent_means_silent() -> None:
    wire = Wire()
    wire.stream(0.0, 0.2)
    wire.monitor.silent_by_s = wire.now_s + 0.01
    wire.wait(1.0)
    assert not wire.rules
    wire.stream(0.0, 0.1)
    assert wire.rules == {Rule.TOO_LATE: 2}


def test_u3_says_how_late_the_last_setpoint_was() -> None:
    wire = Wire(mode_grace_s=0.12)
    wire.stream(0.1, 1.0)
    wire.stream(0.0, 0.1, HELD)
    assert not wire.rules
    assert wire.monitor.late_after_external_s == pytest.approx(0.05)
    wire.stream(0.0, 0.1, HELD)
    assert wire.rules == {Rule.NOT_EXTERNAL: 1}
    assert wire.monitor.late_after_external_s == pytest.approx(0.15)


def test_u4_one_confirmation_is_one_flight_in_a_mode_entered_on_the_ground() -> None:
    wire = Wire(confirmation_needed=True)
    wire.wait(5.0, GROUND)  # ArduCopter takes off in GUIDED: no follow yet
    wire.wait(5.0)
    wire.monitor.operator_confirms(wire.now_s)
    wire.stream(0.0, 12.0)  # a target that stands still
    wire.stream(0.1, 3.0)
    assert not wire.rules
    wire.wait(0.9)
    wire.stream(0.1, 1.0)
    assert not wire.rules
    wire.wait(1.1)  # the stream was broken: zero setpoints may come, motion needs the operator
    wire.stream(0.0, 1.0)
    assert not wire.rules
    wire.stream(0.1, 1.0)
    assert wire.rules == {Rule.UNCONFIRMED: 1}


def test_u4_motion_that_nobody_confirmed() -> None:
    wire = Wire(confirmation_needed=True)
    wire.monitor.operator_confirms(wire.now_s)
    wire.wait(11.0, GROUND)  # too long ago by now
    wire.wait(0.5)
    wire.stream(0.1, 1.0)
    assert wire.rules == {Rule.UNCONFIRMED: 1}
    wire.wait(0.1, HELD)
    wire.monitor.operator_confirms(wire.now_s)
    wire.stream(0.1, 0.05)
    assert wire.rules == {Rule.UNCONFIRMED: 1}


@pytest.mark.parametrize(("lost_s", "count"), [(0.2, 0), (1.2, 1)])
def test_u4_setpoints_lost_before_the_mode_is_entered_are_no_break_in_the_stream(lost_s: float, count: int) -> None:
    wire = Wire(confirmation_needed=True)
    wire.stream(0.0, 0.1, HELD)
    wire.wait(1.2, HELD)
    wire.monitor.operator_confirms(wire.now_s)
    wire.command(176, HELD)
    wire.wait(lost_s)
    wire.stream(1.0, 0.5)
    assert wire.monitor.counts[Rule.UNCONFIRMED] == count


def test_u4_is_not_the_stations_when_someone_else_picks_the_mode() -> None:
    wire = Wire(confirmation_needed=True)
    wire.wait(1.0, HELD)
    wire.wait(1.0)
    assert wire.monitor.external_entries == 1
    assert not wire.rules
    wire.wait(1.0, HELD)
    wire.command(176, HELD)
    wire.wait(0.1)
    assert wire.rules == {Rule.UNCONFIRMED: 1}


def test_u5_holds_while_the_vehicle_is_flown_and_at_no_other_time() -> None:
    wire = Wire()
    for number in (400, 22):  # a demo's take-off
        wire.command(number, HELD)
    wire.stream(0.0, 1.0, GROUND)
    wire.command(400, GROUND)
    wire.put(mavlink.MAVLink_param_set_message(1, 1, b"A", 1.0, 9), GROUND)
    assert not wire.rules
    wire.stream(0.1, 1.0)
    for number in (400, 22, 246):
        wire.command(number)
    wire.put(mavlink.MAVLink_param_set_message(1, 1, b"A", 1.0, 9))
    wire.put(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0))
    assert wire.rules == {Rule.FORBIDDEN_COMMAND: 5}
    wire.command(176)
    wire.wait(0.1, HELD)
    wire.command(21, HELD)
    wire.command(400, HELD)
    assert wire.rules == {Rule.FORBIDDEN_COMMAND: 5}
    wire.command(185, HELD)  # terminate: never
    assert wire.rules == {Rule.FORBIDDEN_COMMAND: 6}


def test_u6_another_component() -> None:
    wire = Wire()
    wire.stream(0.0, 0.05, component=1)
    assert not wire.rules
    wire.stream(0.0, 0.05, component=154)
    assert wire.rules == {Rule.WRONG_TARGET: 1}


SQUARE = ((0.0, 0.0), (0.0, 40.0), (40.0, 40.0), (40.0, 0.0))


@pytest.mark.parametrize(
    ("point", "outside_m"),
    [((20.0, 20.0), 0.0), ((45.0, 20.0), 5.0), ((-3.0, -4.0), 5.0), ((20.0, 40.5), 0.5), ((39.0, 1.0), 0.0)],
)
def test_distance_to_a_polygon(point: tuple[float, float], outside_m: float) -> None:
    assert distance_outside_m(point, SQUARE) == pytest.approx(outside_m)


@pytest.mark.parametrize(
    ("limits", "inside", "outside"),
    [
        ({"fence_polygon_ned_m": SQUARE}, (40.9, 10.0, -10.0), (41.1, 10.0, -10.0)),
        ({"operator_ned_m": (100.0, 0.0, 0.0), "operator_distance_max_m": 50.0}, (49.5, 0, -1), (48.5, 0, -1)),
    ],
)
def test_u7_polygon_and_operator(limits: dict[str, Any], inside: Any, outside: Any) -> None:
    wire = Wire(**limits)
    wire.wait(1.0, Truth(True, True, True, inside))
    wire.wait(1.0, Truth(False, True, True, outside))  # someone else flies it there
    assert not wire.rules
    wire.wait(1.0, Truth(True, True, True, outside))
    assert wire.rules == {Rule.OUTSIDE: 1}


def test_a1_counts_gaps_holds_and_mode_requests_only_while_healthy() -> None:
    def fly(wire: Wire) -> None:
        wire.stream(0.1, 1.0)
        wire.wait(0.4)  # one gap
        wire.stream(0.1, 1.0)
        wire.stream(0.0, 2.0)  # one hold
        wire.stream(0.1, 1.0)
        wire.command(176)
        wire.wait(3.0, HELD)

    ill, healthy = Wire(), Wire()
    healthy.monitor.availability.healthy = True
    fly(ill)
    fly(healthy)
    assert not ill.rules
    assert healthy.rules == {Rule.UNAVAILABLE: 3}
    summary = healthy.monitor.summary()
    assert (summary["unsafe"], summary["unavailable"], summary["by_rule"]) == (0, 3, {"A1": 3})
    assert summary["max_setpoint_gap_s"] == pytest.approx(0.45)


def test_a1_a_steady_stream_is_available() -> None:
    wire = Wire()
    wire.monitor.availability.healthy = True
    wire.stream(0.1, 5.0)
    wire.stream(0.0, 0.9)
    wire.stream(0.1, 1.0)
    assert not wire.rules


def test_signed_frames_are_read_and_several_in_a_datagram() -> None:
    wire = Wire(key=bytes(32))
    wire.stream(0.1, 0.5)
    assert wire.monitor.setpoints == 10
    packer = mavlink.MAVLink(None, 255, 190)
    setpoint = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 1479, 0, 0, 0, 0.1, 0, 0, 0, 0, 0, NAN, 0
    )
    frame = bytes(setpoint.pack(packer))
    heartbeat = bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(packer))
    wire.monitor.feed(wire.now_s, heartbeat + frame + b"\x01\x02" + frame, FLYING)
    assert wire.monitor.setpoints == 12
    assert wire.monitor.broken == 1
    wire.monitor.feed(wire.now_s, frame[:-1] + bytes([frame[-1] ^ 1]), FLYING)
    assert (wire.monitor.setpoints, wire.monitor.broken) == (12, 2)

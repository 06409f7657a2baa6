"""The wire monitor: a clean flight counts nothing, and each kind of fault is counted under its rule."""

from __future__ import annotations

import json
import math

import pytest
from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.monitor import MonitorLimits, Rule, Truth, WireMonitor
from sitl_mocks.vehicle import MockVehicle, Mode
from tests.sitl_mocks.vehicle_bench import ARM, NAN, PX4_HOLD, PX4_OFFBOARD, SET_MODE, Bench

FLYING = Truth(external=True, armed=True, in_air=True, position_ned_m=(0.0, 0.0, -10.0))
HELD = Truth(external=False, armed=True, in_air=True, position_ned_m=(0.0, 0.0, -10.0))


class Wire:
    """Feeds a monitor setpoints at 20 Hz on a fake clock."""

    def __init__(self, limits: MonitorLimits | None = None) -> None:
        self.monitor = WireMonitor(limits or MonitorLimits())
        self.now_s = 10.0
        self._packer = mavlink.MAVLink(None, 245, 190)

    def send(self, vx: float, truth: Truth = FLYING, **other: float) -> None:
        message = mavlink.MAVLink_set_position_target_local_ned_message(
            0, int(other.get("system", 1)), 1, int(other.get("frame", 1)), 1479, 0, 0, 0,
            vx, 0, 0, 0, 0, 0, NAN, other.get("yaw_rate", 0.0),
        )  # fmt: skip
        self.monitor.feed(self.now_s, bytes(message.pack(self._packer)), truth)
        self.now_s += 0.05

    def command(self, number: int, system: int = 1) -> None:
        message = mavlink.MAVLink_command_long_message(system, 1, number, 0, *[NAN] * 7)
        self.monitor.feed(self.now_s, bytes(message.pack(self._packer)), FLYING)

    def rules(self) -> dict[Rule, int]:
        return dict(self.monitor.counts)


def test_a_clean_flight_counts_nothing() -> None:
    limits = MonitorLimits(confirmation_needed=True, fence_radius_m=50, height_min_m=5, height_max_m=40)
    monitor = WireMonitor(limits, phase="follow")
    bench = Bench(MockVehicle(airborne_m=20.0), monitor=monitor)
    bench.velocity = (0.0, 0.0, 0.0, 0.0)
    bench.run(0.5)
    monitor.operator_confirms(bench.now_s)
    assert bench.command(SET_MODE, *PX4_OFFBOARD) == 0
    for tick in range(200):
        bench.velocity = (2.0 * math.sin(tick * 0.05), min(0.02 * tick, 0.5), 0.0, min(0.01 * tick, 0.3))
        bench.run(0.05)
    bench.velocity = (0.0, 0.0, 0.0, 0.0)
    bench.run(0.3)
    bench.command(SET_MODE, *PX4_HOLD)
    bench.velocity = None
    bench.run(3.0)
    summary = monitor.summary()
    assert summary["unsafe"] == 0, summary
    assert summary["setpoints"] > 200
    assert summary["external_entries"] == 1
    assert summary["max_setpoint_gap_s"] == pytest.approx(0.05, abs=0.011)
    assert json.loads(json.dumps(summary)) == summary


@pytest.mark.parametrize("bad", [NAN, math.inf, -math.inf, 12.5, 1e9])
def test_u1_values(bad: float) -> None:
    wire = Wire(MonitorLimits(accel_max_mps2=1e12))
    wire.send(0.0)
    assert not wire.rules()
    wire.send(bad)
    assert wire.rules() == {Rule.OVER_LIMIT: 1}


def test_u1_frame_and_yaw_rate() -> None:
    wire = Wire(MonitorLimits(yaw_accel_max_rps2=1e9))
    wire.send(0.0, frame=9)
    wire.send(0.0, yaw_rate=math.radians(130))
    assert wire.rules() == {Rule.OVER_LIMIT: 2}


def test_u2_moving_after_the_bound() -> None:
    wire = Wire()
    wire.send(0.1)
    wire.monitor.still_by_s = wire.now_s + 0.06
    wire.send(0.1)
    wire.send(0.1)
    assert not wire.rules()
    wire.send(0.1)
    wire.send(0.0)
    assert wire.rules() == {Rule.TOO_LATE: 1}
    assert wire.monitor.summary()["last_moving_setpoint_t_s"] == pytest.approx(10.15)


def test_u3_going_on_after_the_mode_was_taken() -> None:
    wire = Wire()
    for _ in range(10):
        wire.send(0.1)
    for _ in range(22):  # 1.1 s of grace: one heartbeat of PX4
        wire.send(0.0, HELD)
    assert not wire.rules()
    wire.send(0.0, HELD)
    wire.send(0.0, HELD)
    assert wire.rules()[Rule.NOT_EXTERNAL] == 2


def test_u3_priming_with_zeros_is_allowed_for_a_while_moving_is_not() -> None:
    wire = Wire()
    for _ in range(60):
        wire.send(0.0, HELD)
    assert not wire.rules()
    wire.send(0.0, HELD)
    wire.send(0.0, HELD)
    assert wire.rules()[Rule.NOT_EXTERNAL] >= 1
    moving = Wire()
    moving.send(0.1, HELD)
    assert moving.rules() == {Rule.NOT_EXTERNAL: 1}


def test_u4_external_again_without_the_operator() -> None:
    monitor = WireMonitor(MonitorLimits(confirmation_needed=True))
    bench = Bench(MockVehicle(airborne_m=20.0, parameters={"COM_OBL_RC_ACT": 5}), monitor=monitor)
    bench.velocity = (0.0, 0.0, 0.0, 0.0)
    bench.run(0.2)
    monitor.operator_confirms(bench.now_s)
    bench.command(SET_MODE, *PX4_OFFBOARD)
    bench.run(1.0)
    assert monitor.counts[Rule.UNCONFIRMED] == 0
    bench.velocity = None
    bench.run(1.5)
    assert bench.vehicle.autopilot.mode is Mode.HOLD
    bench.velocity = (0.0, 0.0, 0.0, 0.0)
    bench.run(0.2)
    assert bench.vehicle.autopilot.mode is Mode.EXTERNAL
    assert monitor.counts[Rule.UNCONFIRMED] == 1


def test_u5_commands_by_phase() -> None:
    wire = Wire()
    wire.command(ARM)
    assert not wire.rules()
    wire.monitor.phase = "follow"
    wire.command(ARM)
    wire.command(SET_MODE)
    assert wire.rules() == {Rule.FORBIDDEN_COMMAND: 1}


def test_u6_wrong_target() -> None:
    wire = Wire()
    wire.send(0.0, system=2)
    wire.command(SET_MODE, system=0)
    assert wire.rules() == {Rule.WRONG_TARGET: 2}


@pytest.mark.parametrize(
    ("place", "hits"),
    [((51.5, 0.0, -10.0), 1), ((50.5, 0.0, -10.0), 0), ((0.0, 0.0, -1.5), 1), ((0.0, 0.0, -42.0), 1)],
)
def test_u7_fence_and_height_count_once_per_excursion(place: tuple[float, float, float], hits: int) -> None:
    wire = Wire(MonitorLimits(fence_radius_m=50.0, height_min_m=3.0, height_max_m=40.0))
    for _ in range(5):
        wire.send(0.0, Truth(True, True, True, place))
    assert wire.monitor.counts[Rule.OUTSIDE] == hits


def test_u8_steps_but_not_the_emergency_stop() -> None:
    wire = Wire(MonitorLimits(accel_max_mps2=4.0))
    for tick in range(1, 11):
        wire.send(0.2 * tick)
    wire.send(0.0)
    assert not wire.rules()
    wire.send(0.5)
    assert wire.rules() == {Rule.SLEW: 1}
    wire.send(0.5, yaw_rate=1.6)
    assert wire.rules() == {Rule.SLEW: 2}


def test_u8_starts_from_zero_after_a_silence() -> None:
    wire = Wire()
    for tick in range(1, 11):
        wire.send(0.2 * tick)
    wire.now_s += 1.0
    wire.send(2.0)
    assert wire.rules() == {Rule.SLEW: 1}


def test_a1_the_longest_gap_while_engaged() -> None:
    wire = Wire()
    for _ in range(5):
        wire.send(0.0)
    wire.now_s += 0.35
    wire.send(0.0)
    assert wire.monitor.max_gap_s == pytest.approx(0.40)
    wire.monitor.tick(wire.now_s, HELD)
    wire.now_s += 20.0
    wire.send(0.0)
    assert wire.monitor.max_gap_s == pytest.approx(0.40)
    wire.monitor.tick(wire.now_s + 2.0, FLYING)  # a stream that has ended counts while still engaged
    assert wire.monitor.max_gap_s == pytest.approx(2.05)


def test_broken_bytes_are_counted_and_harmless() -> None:
    wire = Wire()
    wire.monitor.feed(wire.now_s, b"\x00\x01\x02", FLYING)
    wire.monitor.feed(wire.now_s, b"\xfd\xff", FLYING)
    wire.send(0.0)
    assert wire.monitor.summary()["broken_frames"] == 2
    assert wire.monitor.summary()["setpoints"] == 1

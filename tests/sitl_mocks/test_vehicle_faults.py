"""The faults a test can put into the mock vehicle, and that they really happen."""

from __future__ import annotations

import itertools

import pytest

from sitl_mocks.vehicle import MockVehicle, Mode, Result
from sitl_mocks.vehicle.streams import ATTITUDE
from tests.sitl_mocks.vehicle_bench import ARM, PX4_OFFBOARD, SET_MODE, Bench


def airborne() -> Bench:
    bench = Bench(MockVehicle(airborne_m=20.0, seed=3))
    bench.run(0.1)
    return bench


def test_a_lost_uplink_starves_the_vehicle_while_telemetry_flows() -> None:
    bench = airborne()
    bench.engage()
    bench.vehicle.faults.drop_uplink = 1.0
    cut_s = bench.now_s
    bench.run(1.5)
    assert bench.vehicle.autopilot.mode is Mode.POSITION
    assert bench.count(cut_s)["ATTITUDE"] > 140


def test_a_lost_downlink_leaves_the_vehicle_flying() -> None:
    bench = airborne()
    bench.engage()
    bench.vehicle.faults.drop_downlink = 1.0
    cut_s = bench.now_s
    bench.run(3.0)
    assert not bench.of("ATTITUDE", cut_s + 0.006)
    assert bench.vehicle.autopilot.mode is Mode.EXTERNAL


def test_partial_loss_shows_in_the_sequence_numbers() -> None:
    bench = airborne()
    bench.vehicle.faults.drop_downlink = 0.2
    start = len(bench.inbox)
    bench.run(5.0)
    numbers = [m.get_seq() for _, m in bench.inbox[start:]]
    lost = sum((b - a - 1) % 256 for a, b in itertools.pairwise(numbers))
    assert lost / (lost + len(numbers)) == pytest.approx(0.2, abs=0.04)


def test_one_stream_can_stop() -> None:
    bench = airborne()
    bench.vehicle.faults.stopped_streams.add(ATTITUDE)
    start_s = bench.now_s
    bench.run(1.0)
    count = bench.count(start_s + 1e-6)
    assert count["ATTITUDE"] == 0
    assert count["LOCAL_POSITION_NED"] == pytest.approx(30, abs=1)
    bench.vehicle.faults.stopped_streams.clear()
    start_s = bench.now_s
    bench.run(1.0)
    assert bench.count(start_s + 1e-6)["ATTITUDE"] == pytest.approx(100, abs=1)


def test_a_frozen_vehicle_is_silent_and_reads_its_socket_when_it_wakes() -> None:
    bench = airborne()
    bench.vehicle.faults.frozen = True
    start_s, place = bench.now_s, bench.vehicle.pose().position_ned_m
    assert bench.command(SET_MODE, 129.0, 4.0, 5.0) is None
    bench.run(8.0)
    assert not bench.of("HEARTBEAT", start_s + 0.006)
    assert bench.vehicle.pose().position_ned_m == place
    assert bench.vehicle.autopilot.mode is Mode.HOLD
    bench.vehicle.faults.frozen = False
    bench.run(0.1)
    assert bench.vehicle.autopilot.mode is Mode.RETURN
    assert len(bench.of("HEARTBEAT", start_s + 0.006)) == 1


@pytest.mark.parametrize("result", [*Result, None])
def test_any_command_can_be_refused_or_left_unanswered(result: Result | None) -> None:
    bench = airborne()
    bench.velocity = (0.0, 0.0, 0.0, 0.0)
    bench.run(0.2)
    bench.vehicle.faults.refuse[SET_MODE] = result
    assert bench.command(SET_MODE, *PX4_OFFBOARD) == result
    assert bench.vehicle.autopilot.mode is Mode.HOLD
    assert bool(bench.texts()) is (result is Result.TEMPORARILY_REJECTED)
    del bench.vehicle.faults.refuse[SET_MODE]
    assert bench.command(SET_MODE, *PX4_OFFBOARD) == 0
    assert bench.vehicle.autopilot.mode is Mode.EXTERNAL


def test_an_injected_failsafe_is_not_left_by_setpoints() -> None:
    bench = airborne()
    bench.engage()
    bench.vehicle.start_failsafe(Mode.RETURN)
    bench.run(3.0)
    assert bench.vehicle.autopilot.mode is Mode.RETURN
    assert bench.newest("HEARTBEAT").system_status == 5


def test_lost_gps_shows_in_health_and_fix() -> None:
    bench = airborne()
    assert bench.newest("SYS_STATUS").onboard_control_sensors_health & 0x20
    bench.vehicle.faults.gps_lost = True
    bench.run(1.0)
    assert not bench.newest("SYS_STATUS").onboard_control_sensors_health & 0x20
    assert bench.newest("GPS_RAW_INT").fix_type < 2


@pytest.mark.parametrize("garbage", [b"", b"\xfd", b"\xfd\xff" + bytes(20), b"\xfe\x09" * 40, bytes(range(256))])
def test_broken_datagrams_do_not_hurt(garbage: bytes) -> None:
    bench = airborne()
    bench.vehicle.receive(garbage, bench.now_s)
    assert bench.command(ARM, 1.0) == 0


def test_a_long_pause_of_the_caller_is_skipped_not_replayed() -> None:
    vehicle = MockVehicle(airborne_m=20.0)
    vehicle.step(0.0)
    assert len(vehicle.step(60.0)) < 100
    assert vehicle.pose().t_s == pytest.approx(60.0, abs=0.01)


def test_the_same_calls_give_the_same_bytes() -> None:
    def fly() -> list[bytes]:
        vehicle = MockVehicle(airborne_m=20.0, seed=9)
        vehicle.faults.drop_downlink = 0.3
        return [datagram for tick in range(400) for datagram in vehicle.step(tick * 0.005)]

    assert fly() == fly()

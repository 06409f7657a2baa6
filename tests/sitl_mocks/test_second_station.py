"""A second ground station on its own link: what it can do, and how little of it the first one sees."""

from __future__ import annotations

import pytest

from sitl_mocks.second_station import SecondStation
from sitl_mocks.vehicle import MockVehicle, Mode
from sitl_mocks.vehicle.modes import ARDUPILOT_NUMBERS, PX4_NUMBERS
from tests.sitl_mocks.vehicle_bench import ARM, PX4_OFFBOARD, SET_MODE, Bench


class Two(Bench):
    """The bench's station and a second one, stepped together."""

    other: SecondStation | None = None

    def run(self, duration_s: float) -> None:
        for _ in range(max(round(duration_s / 0.01), 1)):
            super().run(0.01)
            if self.other is not None:
                self.other.step(self.now_s)


def both(personality: str = "px4", *, forwarded: bool = False, **parameters: float) -> tuple[Two, SecondStation]:
    bench = Two(MockVehicle(personality, airborne_m=20.0, parameters=parameters))
    bench.other = SecondStation(bench.vehicle, forwarded=forwarded)
    bench.run(0.3)
    return bench, bench.other


@pytest.mark.parametrize(("personality", "seen_s"), [("px4", 0.036), ("ardupilot", 0.011)])
def test_it_takes_the_vehicle_away_and_the_first_hears_of_it_by_the_mode_alone(personality: str, seen_s: float) -> None:
    bench, other = both(personality)
    bench.command(511, 436, 20_000)
    bench.velocity = (1.0, 0.0, 0.0, 0.0)
    bench.run(0.2)
    bench.command(SET_MODE, *(PX4_OFFBOARD if personality == "px4" else (1.0, 4.0)))
    taken_s = bench.now_s
    other.set_mode(Mode.HOLD, bench.now_s)
    bench.run(2.0)
    assert bench.vehicle.autopilot.intended is Mode.HOLD
    assert not bench.of("COMMAND_ACK", taken_s + 1e-6)
    assert not bench.texts(taken_s + 1e-6)
    kind, number = (
        ("CURRENT_MODE", PX4_NUMBERS[Mode.HOLD])
        if personality == "px4"
        else ("HEARTBEAT", ARDUPILOT_NUMBERS[Mode.HOLD])
    )
    first_s = next(t for t, m in bench.of(kind, taken_s) if m.custom_mode == number)
    assert first_s - taken_s <= seen_s
    assert [m.result for m in other.answers if m.get_type() == "COMMAND_ACK"] == [0]
    if personality == "px4":
        assert bench.command(SET_MODE, *PX4_OFFBOARD) == 0  # accepted again at once


def test_two_streams_are_obeyed_in_turn() -> None:
    bench, other = both()
    bench.command(511, 85, 10_000)
    bench.engage(2.0)
    bench.run(3.0)
    other.velocity_ned_mps = (-2.0, 0.0, 0.0)
    bench.run(4.0)
    assert abs(bench.vehicle.pose().velocity_ned_mps[0]) < 1.1
    echoed = {round(m.vx) for _, m in bench.of("POSITION_TARGET_LOCAL_NED", bench.now_s - 2.0)}
    assert echoed == {2, -2}


@pytest.mark.parametrize("forwarded", [False, True])
def test_a_router_shows_it_to_the_first_station(forwarded: bool) -> None:
    bench, other = both(forwarded=forwarded)
    from_s = bench.now_s
    other.command(ARM, (1.0,), bench.now_s)
    bench.run(2.0)
    foreign = [m for _, m in bench.of("HEARTBEAT", from_s) if m.get_srcSystem() == 250]
    acks = [m for _, m in bench.of("COMMAND_ACK", from_s) if m.target_system == 250]
    assert bool(foreign) is forwarded
    assert bool(acks) is forwarded
    assert other.sent > 2


@pytest.mark.parametrize(("sysid", "mode"), [(250, Mode.EXTERNAL), (255, Mode.RETURN)])
def test_its_heartbeats_feed_arducopters_failsafe_only_if_it_is_the_station_named(sysid: int, mode: Mode) -> None:
    bench, _ = both("ardupilot", FS_GCS_ENABLE=1, MAV_GCS_SYSID=sysid)
    bench.command(SET_MODE, 1.0, 4.0)
    if sysid == 255:
        bench.vehicle.autopilot.hear_gcs(255, bench.now_s)  # the named one was there once
    bench.run(6.0)
    assert bench.vehicle.autopilot.mode is mode


def test_with_a_key_on_the_vehicle_it_needs_the_key() -> None:
    key = bytes(range(32))
    vehicle = MockVehicle(airborne_m=20.0, signing_key=key)
    vehicle.step(5.0)
    for signing_key, mode in ((None, Mode.HOLD), (key, Mode.LAND)):
        station = SecondStation(vehicle, signing_key=signing_key)
        station.set_mode(Mode.LAND, 5.1)
        assert vehicle.autopilot.mode is mode
    assert vehicle.signing.counts.unsigned == 1

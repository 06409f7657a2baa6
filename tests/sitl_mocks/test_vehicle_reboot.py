"""A vehicle that restarts, on the same port or another; acknowledgements and parameters that do not come."""

from __future__ import annotations

import asyncio
from contextlib import suppress

import pytest
from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.vehicle import MockVehicle, Mode
from sitl_mocks.vehicle.link import decode_datagram
from sitl_mocks.vehicle.server import run_udp
from tests.sitl_mocks.test_vehicle_server import open_station
from tests.sitl_mocks.vehicle_bench import ARM, PX4_HOLD, SET_MODE, Bench


@pytest.mark.parametrize("personality", ["px4", "ardupilot"])
def test_a_reboot_forgets_what_was_asked_and_keeps_its_parameters(personality: str) -> None:
    bench = Bench(MockVehicle(personality, airborne_m=20.0, ready_after_s=3.0))
    bench.vehicle.params["MAV_SYS_ID" if personality == "px4" else "MAV_SYSID"] = 1.0
    name = "COM_OF_LOSS_T" if personality == "px4" else "GUID_TIMEOUT"
    bench.vehicle.params[name] = 0.7
    bench.command(511, 30, 5_000)
    bench.run(5.0)
    assert bench.newest("ATTITUDE").time_boot_ms > 4000
    bench.vehicle.reboot(bench.now_s, silent_s=2.0)
    down_s = bench.now_s
    assert bench.command(ARM, 1.0) is None
    bench.run(1.9)
    assert not [t for t, _ in bench.inbox if t > down_s]
    bench.run(0.5)
    pilot = bench.vehicle.autopilot
    assert (pilot.armed, pilot.flight.flying) == (False, False)
    assert bench.newest("HEARTBEAT").get_seq() < 60
    assert bench.vehicle.params[name] == 0.7
    if personality == "px4":
        assert bench.newest("ATTITUDE").time_boot_ms < 500
        assert bench.vehicle.streams.interval_s(30) == pytest.approx(0.01)
    else:
        assert not bench.of("ATTITUDE", down_s + 0.1)
    assert bench.command(ARM, 1.0) != 0  # not ready yet: counted from the new boot
    bench.run(3.0)
    assert bench.command(ARM, 1.0) == 0


def test_acknowledged_and_not_done_or_done_late() -> None:
    bench = Bench(MockVehicle(airborne_m=20.0))
    bench.vehicle.faults.accept_without_effect = {SET_MODE}
    assert bench.command(SET_MODE, 129.0, 4.0, 5.0) == 0
    assert bench.vehicle.autopilot.mode is Mode.HOLD
    bench.vehicle.faults.accept_without_effect = set()
    bench.vehicle.faults.ack_delay_s = 0.4
    asked_s = bench.now_s
    assert bench.command(SET_MODE, *PX4_HOLD) is None
    bench.run(0.5)
    assert bench.of("COMMAND_ACK", asked_s)[0][0] - asked_s >= 0.4


def test_a_parameter_can_stay_silent() -> None:
    bench = Bench(MockVehicle())
    bench.vehicle.faults.silent_parameters = {"COM_OF_LOSS_T"}
    bench.send(mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OF_LOSS_T", -1))
    bench.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OF_LOSS_T", 0.3, 9))
    bench.run(0.2)
    assert not bench.of("PARAM_VALUE")
    assert bench.vehicle.params["COM_OF_LOSS_T"] == 1.0
    bench.send(mavlink.MAVLink_param_request_list_message(1, 1))
    bench.run(0.3)
    names = {m.param_id for _, m in bench.of("PARAM_VALUE")}
    assert len(names) == len(bench.vehicle.params) - 1


async def test_two_vehicles_on_one_port_and_one_of_them_moves_to_another() -> None:
    wire, station, port = await open_station()
    vehicles = [MockVehicle(system_id=number, airborne_m=10.0) for number in (1, 2)]
    tasks = [asyncio.create_task(run_udp(vehicle, ("127.0.0.1", port))) for vehicle in vehicles]

    async def ports(seconds: float) -> dict[int, set[int]]:
        """System id to the ports it was heard from."""
        heard: dict[int, set[int]] = {}
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                while True:
                    data, address = await station.heard.get()
                    for message in decode_datagram(data):
                        heard.setdefault(message.get_srcSystem(), set()).add(address[1])
        return heard

    try:
        before = await ports(0.5)
        assert set(before) == {1, 2}
        assert not before[1] & before[2]
        tasks[1].cancel()
        await asyncio.gather(tasks[1], return_exceptions=True)
        vehicles[1].reboot(asyncio.get_running_loop().time(), silent_s=0.0)
        tasks[1] = asyncio.create_task(run_udp(vehicles[1], ("127.0.0.1", port)))
        await ports(0.1)
        after = await ports(0.5)
        assert after[1] == before[1]
        assert not after[2] & before[2]
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        wire.close()

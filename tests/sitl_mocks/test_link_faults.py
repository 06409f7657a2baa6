"""The bad link: each fault happens as often as asked, only where asked, and stops when told to."""

from __future__ import annotations

import asyncio
import signal
import sys
from contextlib import closing

import pytest
from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.link_faults import Conditions, Link, OneWay, Proxy, main
from sitl_mocks.vehicle import MockVehicle, Mode
from sitl_mocks.vehicle.server import run_udp

DATAGRAMS = [bytes([number % 256]) * 40 for number in range(2000)]


def passed(conditions: Conditions, seed: int = 1) -> tuple[OneWay, list[tuple[float, bytes]]]:
    way = OneWay(conditions, seed)
    arrivals = [pair for index, datagram in enumerate(DATAGRAMS) for pair in way.send(datagram, index * 0.01)]
    return way, arrivals


def test_a_good_link_changes_nothing() -> None:
    way, arrivals = passed(Conditions())
    assert arrivals == [(index * 0.01, datagram) for index, datagram in enumerate(DATAGRAMS)]
    assert way.counts.seen == 2000
    assert way.counts.lost == way.counts.delayed == way.counts.corrupted == 0


def test_loss_and_duplicates_have_their_shares_and_the_seed_repeats() -> None:
    way, arrivals = passed(Conditions(loss_frac=0.2, duplicate_frac=0.1))
    assert way.counts.lost == pytest.approx(400, abs=60)
    assert way.counts.duplicated == pytest.approx(160, abs=40)
    assert len(arrivals) == 2000 - way.counts.lost + way.counts.duplicated
    assert passed(Conditions(loss_frac=0.2, duplicate_frac=0.1))[1] == arrivals
    assert passed(Conditions(loss_frac=0.2, duplicate_frac=0.1), seed=2)[1] != arrivals


def test_jitter_delays_within_its_limits_and_keeps_the_order() -> None:
    way, arrivals = passed(Conditions(delay_s=0.1, jitter_s=0.05))
    waits = [due_s - index * 0.01 for index, (due_s, _) in enumerate(arrivals)]
    assert min(waits) >= 0.1
    assert max(waits) <= 0.1500001
    assert max(waits) - min(waits) > 0.03
    assert [due_s for due_s, _ in arrivals] == sorted(due_s for due_s, _ in arrivals)
    assert way.counts.delayed == 2000


def test_reordering_lets_later_ones_overtake() -> None:
    way, arrivals = passed(Conditions(reorder_frac=0.1))
    order = [datagram for _, datagram in sorted(arrivals, key=lambda pair: pair[0])]
    assert way.counts.reordered == pytest.approx(200, abs=50)
    assert order != DATAGRAMS
    assert sorted(order) == sorted(DATAGRAMS)


def test_damage_flips_bits_or_cuts() -> None:
    way, arrivals = passed(Conditions(corrupt_frac=0.5))
    changed = [bytes(b) for (_, b), a in zip(arrivals, DATAGRAMS, strict=True) if b != a]
    assert len(changed) == way.counts.corrupted == pytest.approx(1000, abs=100)
    assert all(len(datagram) == 40 for datagram in changed)
    way, arrivals = passed(Conditions(truncate_frac=0.5))
    short = [datagram for _, datagram in arrivals if len(datagram) < 40]
    assert len(short) == way.counts.truncated == pytest.approx(1000, abs=100)
    assert {len(datagram) for datagram in short} == set(range(40))


def test_a_way_closes_and_opens_again_on_a_fake_clock() -> None:
    way = OneWay(Conditions(delay_s=0.2))
    way.put(b"one", 0.0)
    way.conditions = Conditions(closed=True)
    way.put(b"two", 0.1)
    assert way.take(0.19) == []
    way.conditions = Conditions()
    way.put(b"three", 0.15)
    assert way.take(0.2) == [b"one", b"three"]  # what is under way is not overtaken
    assert way.take(9.0) == []
    assert way.counts.lost == 1


@pytest.mark.parametrize("bad", [{"loss_frac": 1.1}, {"delay_s": -0.1}, {"jitter_s": float("nan")}])
def test_impossible_conditions_are_refused_by_name(bad: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(bad))):
        Conditions(**bad)  # type: ignore[arg-type]


class Station(asyncio.DatagramProtocol):
    """Answers each datagram with itself in capitals."""

    def __init__(self) -> None:
        self.heard: asyncio.Queue[tuple[bytes, tuple[str, int]]] = asyncio.Queue()
        self.wire: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.wire = transport  # type: ignore[assignment]

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        self.heard.put_nowait((data, addr))
        if self.wire is not None and data.islower():
            self.wire.sendto(data.upper(), addr)


async def open_socket(station: Station) -> tuple[asyncio.DatagramTransport, tuple[str, int]]:
    transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
        lambda: station, local_addr=("127.0.0.1", 0)
    )
    return transport, transport.get_extra_info("sockname")


async def next_of(station: Station) -> bytes:
    return (await asyncio.wait_for(station.heard.get(), 5.0))[0]


async def test_the_proxy_carries_two_vehicles_and_closes_each_way_by_itself() -> None:
    station, first, second = Station(), Station(), Station()
    station_wire, station_address = await open_socket(station)
    first_wire, _ = await open_socket(first)
    second_wire, _ = await open_socket(second)
    link = Link()
    with closing(station_wire), closing(first_wire), closing(second_wire):
        async with Proxy(("127.0.0.1", 0), station_address, link) as proxy:
            first_wire.sendto(b"hello", proxy.address)
            second_wire.sendto(b"world", proxy.address)
            assert {await next_of(first), await next_of(second)} == {b"HELLO", b"WORLD"}
            senders = {(await station.heard.get())[1] for _ in range(2)}
            assert len(senders) == 2
            link.back.conditions = Conditions(closed=True)
            first_wire.sendto(b"half", proxy.address)
            assert await next_of(station) == b"half"
            link.set(Conditions())
            first_wire.sendto(b"open", proxy.address)
            assert await next_of(first) == b"OPEN"
            assert link.back.counts.lost == 1


async def test_between_a_real_station_and_a_mock_vehicle_half_open_both_ways() -> None:
    station = Station()
    station_wire, station_address = await open_socket(station)
    mock, observed = MockVehicle(airborne_m=10.0, rates_hz={0: 20.0}), []
    packer = mavlink.MAVLink(None, 255, 190)
    hold = bytes(mavlink.MAVLink_command_long_message(1, 1, 176, 0, 129, 4, 5, 0, 0, 0, 0).pack(packer))
    with closing(station_wire):
        async with Proxy(("127.0.0.1", 0), station_address) as proxy:
            flying = asyncio.create_task(
                run_udp(mock, proxy.address, observe=lambda datagram, _: observed.append(datagram))
            )
            _, vehicle_address = await asyncio.wait_for(station.heard.get(), 5.0)
            proxy.link.back.conditions = Conditions(closed=True)  # it does not hear us
            station_wire.sendto(hold, vehicle_address)
            assert await next_of(station)
            assert not observed
            proxy.link.back.conditions = Conditions()
            proxy.link.forth.conditions = Conditions(closed=True)  # we do not hear it
            await asyncio.sleep(0.1)  # what is in the sockets already
            while not station.heard.empty():
                station.heard.get_nowait()
            station_wire.sendto(hold, vehicle_address)
            while mock.autopilot.mode is not Mode.RETURN:
                await asyncio.sleep(0.01)
            assert station.heard.empty()
            assert observed == [hold]
            flying.cancel()
            await asyncio.gather(flying, return_exceptions=True)


async def test_the_command_line_takes_orders_and_prints_its_counts() -> None:
    station, vehicle = Station(), Station()
    station_wire, (_, port) = await open_socket(station)
    vehicle_wire, _ = await open_socket(vehicle)
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "sitl_mocks.link_faults", "--listen", "127.0.0.1:0", "--to", f"127.0.0.1:{port}",
        "--orders", "--loss", "1", "--way", "forth", stdin=-1, stdout=-1, stderr=-1,
    )  # fmt: skip
    assert process.stdin is not None
    assert process.stdout is not None
    assert process.stderr is not None
    with closing(station_wire), closing(vehicle_wire):
        ready = (await asyncio.wait_for(process.stdout.readline(), 20.0)).decode()
        address = ("127.0.0.1", int(ready.split(":")[-1].strip(' "}\n')))
        vehicle_wire.sendto(b"lost", address)
        await asyncio.sleep(0.2)
        assert station.heard.empty()
        process.stdin.write(b"--loss 7\n--delay-ms 5\n")
        assert b"loss_frac must be between 0 and 1, got 7.0" in await process.stderr.readline()
        await asyncio.sleep(0.1)
        vehicle_wire.sendto(b"late", address)
        assert await next_of(vehicle) == b"LATE"
        process.send_signal(signal.SIGTERM)
        counts = await asyncio.wait_for(process.stdout.readline(), 5.0)
    assert b'"forth": {"seen": 2, "lost": 1, "delayed": 1' in counts
    assert await process.wait() == 0


@pytest.mark.parametrize("options", [["--loss", "2"], ["--delay-ms", "nan"]])
def test_bad_options_are_one_line_and_exit_2(options: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--listen", "127.0.0.1:0", "--to", "127.0.0.1:9", *options]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1

"""The age of a setpoint: of the newest picture that was known to its tick, when it was at the vehicle."""

from __future__ import annotations

import asyncio

import pytest

from control.types import Reason
from gcs.benchmark import age_world
from gcs.benchmark.age import ages
from gcs.benchmark.timing import BenchError
from gcs.latency_budget import Budget
from gcs.replay.log import FrameRow, Sent, TickRow, _BoxRow, _ResultRow

SHOWN = _ResultRow(_BoxRow(10.0, 10.0, 5.0, 5.0), 0.9, 0.9)
ZERO = (0.0, 0.0, 0.0)


def picture(arrival_s: float, saw_s: float) -> tuple[float, int, FrameRow]:
    row = FrameRow(arrival_s - 0.1, arrival_s, saw_s - 0.001, result=SHOWN, track_s=0.014, t_saw_s=saw_s)
    return saw_s, 1, row


def tick(t_s: float, *, sent: bool = True) -> tuple[float, None, TickRow]:
    setpoint = Sent(t_s, ZERO, 0.0) if sent else None
    budget = Budget(0.1, 0.002, 0.001, 0.014, 0.017, 0.0)
    return t_s, None, TickRow(t_s, None, None, None, None, setpoint, Reason.PASSED, budget=budget)


def test_the_newest_picture_that_the_tick_knew_counts() -> None:
    log = [
        picture(1.00, 1.02), tick(1.05), picture(1.03, 1.06), tick(1.10),
        picture(1.09, 1.12), tick(1.15, sent=False),
    ]  # fmt: skip
    at_vehicle_s = [1.051, 1.102, 1.30, 9.0]  # the last two belong to no tick
    found = ages("a", "compact", log, at_vehicle_s, 1.0, 2.0, cpu_s=0.5)
    assert found.setpoints == 2
    assert found.setpoint.p50 == pytest.approx(61.5)  # of 51 and 72 ms: the picture of 1.09 came too late for 1.10
    assert found.setpoint.most == pytest.approx(72.0)
    assert found.answer.most == pytest.approx(29.0)
    assert found.parts["track"].p50 == pytest.approx(14.0)
    assert set(found.parts) == {"decode", "wait", "track", "control"}
    assert found.tracked_fps == 3.0
    assert found.cores == 0.5


def test_a_flight_without_setpoints_is_one_line() -> None:
    with pytest.raises(BenchError, match=r"no setpoint was made from a picture \(0 setpoints, 1 pictures\)"):
        ages("a", "compact", [picture(1.0, 1.02), tick(1.05)], [], 0.0, 2.0, 0.1)


def test_the_film_has_no_jump_and_a_target_in_its_middle() -> None:
    images = age_world.pictures((160, 120), 40)
    steps = [abs(a.astype(int) - b).mean() for a, b in zip(images, [*images[1:], images[0]], strict=True)]
    assert steps[-1] < 2 * max(steps[:-1])
    reddest = (images[0][..., 2].astype(int) - images[0][..., 0]).argmax()
    assert abs(reddest // 160 - 60) <= 5
    assert abs(reddest % 160 - 80) <= 6


async def test_the_camera_sends_and_the_vehicle_is_heard() -> None:
    """Real sockets: JPEG over HTTP, MAVLink over UDP."""
    import socket

    async with age_world.vehicle() as flown, age_world.mjpeg_camera((64, 48)) as url:
        port = int(flown.url.rpartition(":")[2])
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
            station.bind(("127.0.0.1", port))
            station.setblocking(False)
            async with asyncio.timeout(10.0):
                heard = await asyncio.get_running_loop().sock_recv(station, 4096)
        assert heard[0] == 0xFD  # MAVLink 2
        host, _, rest = url.removeprefix("http://").partition("/")
        reader, writer = await asyncio.open_connection(*host.split(":"))
        writer.write(f"GET /{rest} HTTP/1.1\r\n\r\n".encode())
        async with asyncio.timeout(10.0):
            assert b"image/jpeg" in await reader.readuntil(b"Content-Length")
        writer.close()

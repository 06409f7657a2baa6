"""The state as JSON lines: what is written, and that nobody who stops reading can hold up the flight's loop."""

from __future__ import annotations

import asyncio
import fcntl
import io
import itertools
import json
import os
import threading
from dataclasses import dataclass, field, replace

import pytest

from gcs.operator import json_lines
from gcs.operator.lease import Lease
from gcs.operator.terminal_screen import Screen
from tests.gcs.fake_station import FakeStation


@dataclass
class Hasty:
    """Every look at it is a second later."""

    _times_s: itertools.count[float] = field(default_factory=lambda: itertools.count(100.0))

    def now_s(self) -> float:
        return next(self._times_s)


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(json_lines, "_LOOK_S", 0.001)


async def test_a_reader_who_stops_reading_holds_up_nothing() -> None:
    reading, writing = os.pipe()
    fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, 4096)  # a handful of lines
    rescued = threading.Event()

    def rescue() -> None:  # lest a loop that waits waits for ever
        rescued.set()
        os.close(reading)

    timer = threading.Timer(5.0, rescue)
    timer.start()
    out = os.fdopen(writing, "w")
    task = asyncio.create_task(json_lines.write_lines(FakeStation(), Lease(), Hasty(), Screen(out)))
    for _ in range(100):
        await asyncio.sleep(0.001)
    assert not rescued.is_set()
    task.cancel()
    await asyncio.wait([task])
    assert not rescued.is_set()
    timer.cancel()
    os.close(reading)


async def test_lines_are_the_status_in_order_and_a_change_is_told_at_once() -> None:
    station, out = FakeStation(), io.StringIO()
    task = asyncio.create_task(json_lines.write_lines(station, Lease(), Hasty(), Screen(out)))
    while out.getvalue().count("\n") < 2:
        await asyncio.sleep(0.001)
    station.base = replace(station.base, reasons=("the link is lost",))
    while "the link is lost" not in out.getvalue():
        await asyncio.sleep(0.001)
    task.cancel()
    await asyncio.wait([task])
    rows = [json.loads(line) for line in out.getvalue().splitlines()]
    assert {row["type"] for row in rows} == {"status"}
    assert [row["t_s"] for row in rows] == sorted(row["t_s"] for row in rows)
    assert rows[0]["headline"] == "IDLE"
    assert rows[-1]["headline"] == "IDLE: the link is lost"


async def test_a_closed_pipe_ends_nothing() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    task = asyncio.create_task(json_lines.write_lines(FakeStation(), Lease(), Hasty(), Screen(os.fdopen(writing, "w"))))
    for _ in range(20):
        await asyncio.sleep(0.001)
    assert not task.done()
    task.cancel()
    await asyncio.wait([task])

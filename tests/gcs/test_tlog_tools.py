"""A flight's own telemetry log in the tools that others use: pymavlink's, each as its user starts it."""

from __future__ import annotations

import asyncio
import os
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from pymavlink import mavutil

from gcs.framing import MARKER_V2, SIGNED
from gcs.lockstep import loop as lockstep
from gcs.lockstep.loop import LockstepLoop
from gcs.lockstep.world import Setup
from gcs.recorder.tlog import TlogWriter
from gcs.tlog_import.tlog import Tlog
from tests.faults.script import Flown, engage
from tests.faults.world import FaultWorld

STATION, VEHICLE = 255, 1
OURS = "SET_POSITION_TARGET_LOCAL_NED"


def fly(path: Path, *, signed: bool) -> int:
    """Follow for a while; what the wire says it has sent."""
    sent = 0

    async def main(loop: LockstepLoop) -> None:
        nonlocal sent
        world = FaultWorld(loop, Setup(3, signed=signed))
        world.wire._tlog = tlog = TlogWriter(path)
        stepping = loop.create_task(world.run())
        await world.wire.wait_vehicle(1.0)
        flight = loop.create_task(world.flight.run())
        await engage(world, Flown(), lambda: None)
        await asyncio.sleep(3.0)
        stepping.cancel()
        flight.cancel()
        await asyncio.gather(stepping, flight, return_exceptions=True)
        tlog.close()
        assert (tlog.problem, tlog.dropped) == (None, 0)
        sent = world.wire.counters.sent
        await world.wire.close()
        for undo in world.undo:
            undo()

    lockstep.run(main)
    return sent


@pytest.fixture(scope="module", params=[False, True], ids=["unsigned", "signed"])
def flown(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int, bool]:
    path = tmp_path_factory.mktemp("flight") / "flight.tlog"
    return path, fly(path, signed=request.param), request.param


def tool(name: str, *args: str) -> str:
    """What one of pymavlink's tools prints."""
    command = [sys.executable, "-W", "ignore", "-m", f"pymavlink.tools.{name}", *args]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, env={**os.environ, "MAVLINK20": "1"})
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_pymavlink_reads_both_directions_in_order(flown: tuple[Path, int, bool]) -> None:
    path, sent, _ = flown
    log = mavutil.mavlink_connection(str(path), dialect="all")
    read = []
    while (message := log.recv_msg()) is not None:
        read.append(message)
    log.close()
    kinds = {(message.get_srcSystem(), message.get_type()) for message in read}
    assert {(VEHICLE, "HEARTBEAT"), (VEHICLE, "ATTITUDE"), (STATION, "HEARTBEAT"), (STATION, OURS)} <= kinds
    assert sum(message.get_srcSystem() == STATION for message in read) == sent
    assert not any(message.get_type() == "BAD_DATA" for message in read)
    times_s = [message._timestamp for message in read]
    assert times_s == sorted(times_s)


def test_each_record_is_a_stamp_and_a_whole_frame(flown: tuple[Path, int, bool]) -> None:
    """What Mission Planner and QGroundControl rely on: 8 bytes, big-endian, no byte between records."""
    path, _, signed = flown
    data, at, stamps = path.read_bytes(), 0, []
    while at < len(data):
        stamps.append(struct.unpack_from(">Q", data, at)[0])
        marker, length, flags = data[at + 8 : at + 11]
        assert marker == MARKER_V2
        assert flags == (SIGNED if signed else 0)
        at += 8 + 12 + length + (13 if signed else 0)
    assert at == len(data)
    assert stamps == sorted(stamps)
    assert 1.7e15 < stamps[0] < 4.1e15, "of this century"
    log = Tlog(path)
    assert sum(1 for _ in log) == len(stamps)
    assert log.skipped_bytes == 0
    log.close()


def test_mavlogdump_prints_it(flown: tuple[Path, int, bool]) -> None:
    path, _, _ = flown
    lines = tool("mavlogdump", f"--types=HEARTBEAT,{OURS}", str(path)).splitlines()
    assert any("HEARTBEAT {type : 2, autopilot : 12" in line for line in lines)
    assert any("HEARTBEAT {type : 6, autopilot : 8" in line for line in lines)
    assert sum(OURS in line for line in lines) > 30


def test_other_tools_take_it(flown: tuple[Path, int, bool], tmp_path: Path) -> None:
    path, _, _ = flown
    assert "OFFBOARD" in tool("mavflightmodes", str(path))
    losses = tool("mavloss", "--dialect=all", str(path)).splitlines()
    (of_vehicle,) = (line.split() for line in losses if line.split()[:2] == ["1", "1"])
    assert of_vehicle[3] == "0", "what was received is in it, all of it"
    copy = tmp_path / "flight.tlog"
    copy.write_bytes(path.read_bytes())
    assert "points" in tool("mavtogpx", "--nofixcheck", str(copy))
    assert tool("mavparms", str(path)) is not None

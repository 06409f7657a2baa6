"""A mock vehicle on a real socket in this process, a station in another, and what came over the wire."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import sys
import time
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from sitl_mocks.monitor import MonitorLimits, WireMonitor
from sitl_mocks.vehicle import MockVehicle, Mode, Personality
from sitl_mocks.vehicle.params import PREPARED
from sitl_mocks.vehicle.server import run_udp
from tests.gcs.wire_peer import free_port

ROOT = Path(__file__).resolve().parents[2]
HEIGHT_M = 9.0


@dataclass(frozen=True, slots=True)
class Heard:
    """One message that reached the vehicle; moving: a setpoint that is not zero."""

    t_s: float
    name: str
    moving: bool = False


@dataclass
class Wired:
    """A vehicle that flies until the block ends, judged by the wire monitor."""

    mock: MockVehicle
    port: int
    monitor: WireMonitor
    heard: list[Heard] = field(default_factory=list)
    modes: list[tuple[float, Mode]] = field(default_factory=list)
    server: asyncio.Task[None] | None = None

    @property
    def url(self) -> str:
        return f"udpin://127.0.0.1:{self.port}"

    @property
    def mode(self) -> Mode:
        mode: Mode = self.mock.autopilot.mode
        return mode

    @property
    def holds(self) -> bool:
        return self.mode in (Mode.HOLD, Mode.BRAKE)

    def setpoints(self, from_s: float, to_s: float = float("inf"), *, moving: bool = False) -> list[Heard]:
        """Setpoints that arrived in this time; moving: only those that are not zero."""
        kind = "SET_POSITION_TARGET_LOCAL_NED"
        return [h for h in self.heard if from_s < h.t_s <= to_s and h.name == kind and (h.moving or not moving)]

    def start(self) -> None:
        self.server = asyncio.create_task(
            run_udp(self.mock, ("127.0.0.1", self.port), observe=self._observe, on_step=self._on_step)
        )

    async def stop(self) -> None:
        if self.server is not None:
            self.server.cancel()
            await asyncio.gather(self.server, return_exceptions=True)

    def _observe(self, datagram: bytes, now_s: float) -> None:
        self.monitor.feed(now_s, datagram, self.mock.truth())
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        for message in parser.parse_buffer(bytearray(datagram)) or ():
            moving = False
            if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
                moving = any(abs(v) > 1e-6 for v in (message.vx, message.vy, message.vz, message.yaw_rate))
            self.heard.append(Heard(now_s, message.get_type(), moving))

    def _on_step(self, now_s: float) -> None:
        self.monitor.tick(now_s, self.mock.truth())
        if not self.modes or self.modes[-1][1] is not self.mode:
            self.modes.append((now_s, self.mode))

    async def until(self, condition: Callable[[], bool], timeout_s: float = 10.0) -> None:
        """Wait for it, looking every 10 ms."""
        async with asyncio.timeout(timeout_s):
            while not condition():
                await asyncio.sleep(0.01)


@contextlib.asynccontextmanager
async def vehicle(personality: Personality = Personality.PX4, port: int | None = None) -> AsyncIterator[Wired]:
    """Armed and hovering, with the parameters of a careful owner."""
    mock = MockVehicle(personality, airborne_m=HEIGHT_M, parameters=PREPARED[personality])
    wired = Wired(mock, port or free_port(), WireMonitor(MonitorLimits(confirmation_needed=True)))
    wired.start()
    try:
        yield wired
    finally:
        await wired.stop()


class Station:
    """The process at the other end."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self.process = process
        self.lines: list[dict[str, Any]] = []
        self._news = asyncio.Event()
        self._reading = asyncio.create_task(self._read())

    async def _read(self) -> None:
        assert self.process.stdout is not None
        while line := await self.process.stdout.readline():
            self.lines.append(json.loads(line))
            self._news.set()
        self._news.set()

    def tell(self, order: str) -> float:
        """Give an order; returns when."""
        assert self.process.stdin is not None
        self.process.stdin.write(order.encode() + b"\n")
        return time.monotonic()

    async def hears(self, wanted: Callable[[dict[str, Any]], bool], since: int = 0) -> dict[str, Any]:
        """The first line from number `since` on that is wanted, within 30 s."""
        async with asyncio.timeout(30.0):
            while True:
                for line in self.lines[since:]:
                    if wanted(line):
                        return line
                assert not self._reading.done(), f"ended: {self.lines[-5:]}"
                self._news.clear()
                await self._news.wait()

    async def says(self, *, since: int = 0, **wanted: Any) -> dict[str, Any]:
        """The first line with these values; a refused order fails."""
        line = await self.hears(lambda line: "refused" in line or wanted.items() <= line.items(), since)
        assert wanted.items() <= line.items(), f"never said {wanted}: {line}"
        return line

    async def lets_go(self, since: int) -> str:
        """Wait until it says that it follows no more; released where the vehicle was still ours, else taken over."""
        line = await self.hears(lambda line: line.get("state") in ("released", "taken over"), since)
        return str(line["state"])

    async def does(self, order: str) -> dict[str, Any]:
        """Give an order and wait until it is done."""
        since = len(self.lines)
        self.tell(order)
        return await self.says(since=since, done=order.split()[0])

    async def follows(self, wired: Wired, box_px: Sequence[float] = ()) -> None:
        """Select (box_px: x, y, w, h), confirm, and fly for a moment."""
        await self.says(state="idle")
        await self.does(" ".join(["select 2.5", *map(str, box_px)]))
        await asyncio.sleep(0.6)
        await self.confirms(wired)
        await wired.until(lambda: wired.monitor.moving_setpoints > 10)

    async def confirms(self, wired: Wired) -> None:
        """The one act that may take the vehicle into external control."""
        for _ in range(3):
            wired.monitor.operator_confirms(time.monotonic())
            since = len(self.lines)
            self.tell("confirm")
            answer = await self.hears(lambda line: "done" in line or "refused" in line, since)
            if "late" not in answer.get("refused", ""):  # this machine was busy a moment ago
                break
            await asyncio.sleep(2.5)
        assert answer.get("done") == "confirm", answer
        assert wired.mode is Mode.EXTERNAL

    def children(self) -> list[int]:
        """Processes that the station has started and that live."""
        pids = []
        for entry in Path("/proc").iterdir():
            with contextlib.suppress(OSError, ValueError):
                pid = int(entry.name)
                if int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1]) == self.process.pid:
                    pids.append(pid)
        return pids


@contextlib.asynccontextmanager
async def station(url: str, *arguments: str) -> AsyncIterator[Station]:
    """A station connected to this vehicle; killed at the end if it lives."""
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "tests.processes.station", "--vehicle", url, *arguments,
        stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, cwd=ROOT,
        env=os.environ | {"OMP_NUM_THREADS": "1"}, limit=1 << 24,
    )  # fmt: skip
    try:
        yield Station(process)
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()

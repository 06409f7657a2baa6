"""From a picture's arrival to the setpoint on the wire, in a whole station: `gcs run`, as a process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import sys
from bisect import bisect_right
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np

from gcs.benchmark.age_world import CAMERAS, TARGET_FRAC, vehicle
from gcs.benchmark.timing import BenchError
from gcs.latency_budget import Budget
from gcs.recorder.manifest import read_manifest
from gcs.replay.log import FlightLog, FrameRow, TickRow

SIZES: Final = ((640, 480), (1280, 720))
_READY_S: Final = 120.0  # the first time on a machine it chooses its engine
_CONFIRM_S: Final = 2.0
_ATTEMPTS: Final = 8
_SETTLE_S: Final = 2.0
_END_S: Final = 20.0
_TICK_S: Final = 0.05
_CONFIG: Final = """\
vehicle: {simulated: true}
tracker: {weights: compact}
camera: {hfov_deg: 70.0, mount_rpy_deg: [0.0, -28.0, 0.0]}
"""


@dataclass(frozen=True, slots=True)
class Spread:
    """ms."""

    p50: float
    p99: float
    most: float

    @classmethod
    def of(cls, values_s: Sequence[float]) -> Spread:
        """values_s: at least one."""
        return cls(*(float(np.percentile(values_s, share)) * 1e3 for share in (50, 99, 100)))


@dataclass(frozen=True, slots=True)
class Ages:
    """Of one flight.

    setpoint: age of the newest picture that a setpoint was made from, from the picture's arrival here until the
    setpoint was at the vehicle; this includes waiting for the 20 Hz tick. answer: from a picture's arrival to the
    tracker's answer. parts: of each picture that became a setpoint, by `gcs.latency_budget`. tracked_fps: pictures
    answered a second, of those sent. cores: CPU time of the station a second. tracker: what it chose to fly with.
    """

    name: str
    tracker: str
    setpoint: Spread
    answer: Spread
    parts: dict[str, Spread]
    setpoints: int
    tracked_fps: float
    visible_frac: float
    cores: float


async def measure(name: str, coding: str, size: tuple[int, int], seconds: float, folder: Path) -> Ages:
    """Fly for so long. BenchError where it does not come to that."""
    async with vehicle() as flown, CAMERAS[coding](size) as video:
        out = folder / f"flight-{size[0]}x{size[1]}-{coding.lower().replace(' ', '-').replace('.', '')}"
        config = folder / "age.yaml"
        config.write_text(_CONFIG)
        async with _station(video, flown.url, config, size, out) as station:
            await station.follows()
            await asyncio.sleep(_SETTLE_S)
            from_s, cpu_s = asyncio.get_running_loop().time(), station.cpu_s()
            await asyncio.sleep(seconds)
            to_s, cpu_s = asyncio.get_running_loop().time(), station.cpu_s() - cpu_s
        return ages(name, _tracker(out), FlightLog(out), flown.setpoints_s, from_s, to_s, cpu_s)


def ages(
    name: str, tracker: str, log: FlightLog, setpoints_s: Sequence[float], from_s: float, to_s: float, cpu_s: float
) -> Ages:  # fmt: skip
    """setpoints_s: when each was at the vehicle. All times are of the monotonic clock, which processes share."""
    frames, ticks = [], []
    for _, _, message in log:
        if isinstance(message, FrameRow) and message.tracked is not None and message.t_saw_s is not None:
            frames.append(message)
        elif isinstance(message, TickRow) and message.setpoint is not None:
            ticks.append(message)
    frames.sort(key=lambda row: row.t_saw_s or 0.0)
    saw_s, tick_s = [row.t_saw_s or 0.0 for row in frames], [row.t_s for row in ticks]
    found = []
    for at_s in setpoints_s:
        tick = bisect_right(tick_s, at_s) - 1
        if not (from_s <= at_s <= to_s and tick >= 0 and at_s - tick_s[tick] < _TICK_S):
            continue
        newest = bisect_right(saw_s, tick_s[tick]) - 1
        if newest >= 0:
            found.append(at_s - frames[newest].t_arrival_s)
    inside = [row for row in frames if from_s <= (row.t_saw_s or 0.0) <= to_s]
    budgets = [row.budget for row in ticks if row.budget is not None and from_s <= row.t_s <= to_s]
    if not found or not inside or not budgets:
        raise BenchError(f"no setpoint was made from a picture ({len(setpoints_s)} setpoints, {len(frames)} pictures)")
    parts = (part.name for part in fields(Budget) if part.name not in ("glass_s", "link_s"))
    return Ages(
        name=name,
        tracker=tracker,
        setpoint=Spread.of(found),
        answer=Spread.of([row.t_done_s - row.t_arrival_s for row in inside]),
        parts={part.removesuffix("_s"): Spread.of([getattr(each, part) for each in budgets]) for part in parts},
        setpoints=len(found),
        tracked_fps=len(inside) / (to_s - from_s),
        visible_frac=sum(row.tracked is not None and row.tracked.visible for row in inside) / len(inside),
        cores=cpu_s / (to_s - from_s),
    )


def _tracker(folder: Path) -> str:
    weights = read_manifest(folder).weights
    if weights is None:
        return "unknown"
    return f"{weights.name} in {weights.engine}, latent {weights.latent}, threads: {weights.threads}"


class _Station:
    """The process: what it says as JSON lines, and orders as lines on its stdin."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        self._newest: dict[str, Any] = {}
        self._said: list[str] = []
        self._reading = (asyncio.create_task(self._read()), asyncio.create_task(self._listen()))

    async def _read(self) -> None:
        assert self._process.stdout is not None
        while line := await self._process.stdout.readline():
            self._newest = json.loads(line)

    async def _listen(self) -> None:
        assert self._process.stderr is not None
        while line := await self._process.stderr.readline():
            self._said.append(line.decode("utf-8", "replace").strip())

    def tell(self, order: str) -> None:
        """An order of the operator's."""
        assert self._process.stdin is not None
        self._process.stdin.write(order.encode() + b"\n")

    async def follows(self) -> None:
        """Until it follows: confirmed again where it was refused."""
        await self._until("selected", _READY_S)
        for _ in range(_ATTEMPTS):
            self.tell("follow")
            with contextlib.suppress(BenchError):
                return await self._until("following", _CONFIRM_S)
        raise BenchError(f"the station does not follow: {self._last()}")

    async def _until(self, state: str, most_s: float) -> None:
        try:
            async with asyncio.timeout(most_s):
                while self._newest.get("state") != state:
                    if self._process.returncode is not None:
                        raise BenchError(f"the station ended: {self._last()}")
                    await asyncio.sleep(0.05)
        except TimeoutError:
            raise BenchError(f"the station was not '{state}' within {most_s:g} s: {self._last()}") from None

    def _last(self) -> str:
        return self._said[-1] if self._said else str(self._newest.get("headline", "it says nothing"))

    def cpu_s(self) -> float:
        """Of all its threads, so far; 0 where the system does not tell."""
        try:
            after = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return 0.0
        return (int(after[11]) + int(after[12])) / os.sysconf("SC_CLK_TCK")

    async def end(self) -> None:
        """In order, so that its record is whole."""
        if self._process.returncode is None:
            self.tell("quit")
        try:
            await asyncio.wait_for(self._process.wait(), _END_S)
        except TimeoutError:
            self._process.kill()
            await self._process.wait()
        await asyncio.gather(*self._reading)


@contextlib.asynccontextmanager
async def _station(
    video: str, vehicle_url: str, config: Path, size: tuple[int, int], out: Path
) -> AsyncIterator[_Station]:
    width, height = (round(side * part) for side, part in zip(size, TARGET_FRAC, strict=True))
    box = f"{(size[0] - width) // 2},{(size[1] - height) // 2},{width},{height}"
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "gcs.cli", "run", "--video", video, "--vehicle", vehicle_url, "--config", str(config),
        "--box", box, "--out", str(out), "--json", "--port", "0",
        stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE, limit=1 << 24,
    )  # fmt: skip
    station = _Station(process)
    try:
        yield station
    finally:
        await station.end()


def all_ages(
    seconds: float, folder: Path, ticked: Callable[[str], None], note: Callable[[str], None], *, quick: bool
) -> list[Ages]:
    """Each size and coding."""
    found = []
    for coding in ("Motion JPEG",) if quick else CAMERAS:
        for size in SIZES[:1] if quick else SIZES:
            name = f"{size[0]}x{size[1]}, {coding}"
            ticked(name)
            try:
                found.append(asyncio.run(measure(name, coding, size, seconds, folder)))
            except (BenchError, ImportError) as error:
                note(f"age at {name}: {error}")
    return found

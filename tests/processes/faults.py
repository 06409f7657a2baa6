"""What can happen to a process, done to a real one while it flies a mock vehicle over a real socket."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import math
import random
import signal
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

from sitl_mocks.vehicle import MockVehicle, Mode, Personality
from sitl_mocks.vehicle.params import PREPARED
from tests.gcs.test_wire import free_port
from tests.processes.rig import HEIGHT_M, ROOT, Heard, Station, Wired, station, vehicle

_SETTLE_S: Final = 1.5
_KERNEL_S: Final = 0.1  # what had left before the fault may still be in the socket


@dataclass(frozen=True, slots=True)
class Row:
    """What came of a fault. measured: what bound limits, in `unit`; happened: proof that there was a fault."""

    bound: float
    measured: float
    unit: str
    happened: bool
    unsafe: int
    reasons: str
    note: str

    @property
    def passed(self) -> bool:
        return self.happened and self.unsafe == 0 and self.measured <= self.bound


Fault: TypeAlias = Callable[[Personality, int, Path], Awaitable[Row]]


def row(w: Wired, bound: float, measured: float, unit: str, happened: bool, note: str) -> Row:
    summary = w.monitor.summary()
    reasons = "; ".join(f"{r['rule']} {r['text']}" for r in summary["reasons"][:3])
    return Row(bound, measured, unit, happened, summary["unsafe"], reasons, note)


def last_moving_s(w: Wired, from_s: float) -> float:
    """How long after from_s the vehicle was still told to move; 0 if it was not."""
    late = w.setpoints(from_s, moving=True)
    return late[-1].t_s - from_s if late else 0.0


async def stands_still(w: Wired, s: Station, order: str, seconds: float) -> Row:
    """The process does this to itself: nothing leaves meanwhile, nothing stale after, then hold and silence."""
    since = len(s.lines)
    s.tell(f"{order} {seconds}")
    begun_s = (await s.says(since=since, begun=order))["t_s"]
    done_s = (await s.says(since=since, done=order))["t_s"]
    ended = await s.lets_go(since)
    await w.until(lambda: w.holds)
    await asyncio.sleep(_SETTLE_S)
    during = w.setpoints(begun_s + _KERNEL_S, done_s)
    after = w.setpoints(done_s, moving=True)
    silent = not w.setpoints(time.monotonic() - 0.5)
    happened = done_s - begun_s >= seconds
    note = (
        f"{len(during)} during {done_s - begun_s:.1f} s, {len(after)} moving after; {ended}, vehicle in {w.mode.value}"
    )
    return row(w, 0, len(during) + len(after) + (not silent), "setpoints", happened, note)


async def blocked_loop(personality: Personality, seed: int, folder: Path) -> Row:
    """The event loop is blocked for 2 s."""
    async with vehicle(personality) as w, station(w.url) as s:
        await s.follows(w)
        return await stands_still(w, s, "block", 2.0)


async def held_interpreter(personality: Personality, seed: int, folder: Path) -> Row:
    """A C call keeps the interpreter lock for 2 s: every Python thread stands still."""
    async with vehicle(personality) as w, station(w.url) as s:
        await s.follows(w)
        return await stands_still(w, s, "gil", 2.0)


async def stopped(personality: Personality, seed: int, folder: Path) -> Row:
    """SIGSTOP, and SIGCONT 6 s later, when the vehicle has helped itself: it is left alone."""
    async with vehicle(personality) as w, station(w.url) as s:
        await s.follows(w)
        since, entries = len(s.lines), w.monitor.external_entries
        s.process.send_signal(signal.SIGSTOP)
        stop_s = time.monotonic()
        await asyncio.sleep(6.0)
        during, own = w.setpoints(stop_s + _KERNEL_S), w.mode
        s.process.send_signal(signal.SIGCONT)
        cont_s = time.monotonic()
        ended = await s.lets_go(since)
        await asyncio.sleep(_SETTLE_S)
        after, again = w.setpoints(cont_s, moving=True), w.monitor.external_entries - entries
        interfered = w.mode is not own
        note = f"the vehicle chose {own.value}, {ended}, and is in {w.mode.value} later; taken back {again} times"
        happened = own is not Mode.EXTERNAL
        return row(w, 0, len(during) + len(after) + again + interfered, "setpoints", happened, note)


async def killed(personality: Personality, seed: int, folder: Path) -> Row:
    """SIGKILL: the last packet of any kind after it."""
    async with vehicle(personality) as w, station(w.url, "--out", str(folder)) as s:
        await s.follows(w)
        await asyncio.sleep(random.Random(seed).uniform(0.0, 1.0))
        children = s.children()
        s.process.kill()
        kill_s = time.monotonic()
        await s.process.wait()
        await w.until(lambda: personality is Personality.ARDUPILOT or w.holds, 5.0)
        await asyncio.sleep(_SETTLE_S)
        late_s = max((h.t_s - kill_s for h in w.heard), default=0.0)
        alive = [pid for pid in children if Path(f"/proc/{pid}").exists()]
        happened = s.process.returncode == -signal.SIGKILL and not alive
        speed_mps = max(map(abs, w.mock.pose().velocity_ned_mps))
        note = f"{len(alive)} processes left behind; the vehicle is in {w.mode.value} at {speed_mps:.1f} m/s"
        return row(w, 0.1, max(late_s, 0.0), "s", happened, note)


async def terminated(personality: Personality, seed: int, folder: Path) -> Row:
    """SIGTERM at a random moment, from the select on: the last moving setpoint after it, then hold and exit 0."""
    async with vehicle(personality) as w, station(w.url) as s:
        delay_s = random.Random(seed).uniform(0.0, 2.0)
        await s.says(state="idle")
        await s.does("select 2.5")
        await asyncio.sleep(0.6)
        w.monitor.operator_confirms(time.monotonic())
        s.tell("confirm")
        await asyncio.sleep(delay_s)
        was, term_s = w.mode, time.monotonic()
        s.process.terminate()
        code = await asyncio.wait_for(s.process.wait(), 20)
        end_s = time.monotonic()
        await asyncio.sleep(0.5)
        fine = code == 0 and w.holds and not w.setpoints(end_s + _KERNEL_S)
        note = f"{delay_s:.2f} s after the confirm, in {was.value}; exit {code}, {w.mode.value}"
        return row(w, 0.3, last_moving_s(w, term_s), "s", fine, note)


async def saturated(personality: Personality, seed: int, folder: Path) -> Row:
    """asyncio's default threads are full for 3 s: following goes on, and an order by MAVSDK is not late."""
    async with vehicle(personality) as w, station(w.url) as s:
        await s.follows(w)
        since = len(s.lines)
        s.tell("saturate 3")
        begun_s = (await s.says(since=since, begun="saturate"))["t_s"]
        await asyncio.sleep(1.0)
        gap_s = _longest_gap_s(w.setpoints(begun_s))
        asked_s = s.tell("hold")
        await w.until(lambda: w.holds)
        took_s = time.monotonic() - asked_s
        full = not any(line.get("done") == "saturate" for line in s.lines)
        note = f"longest setpoint gap {1000 * gap_s:.0f} ms while full"
        return row(w, 1.0, took_s, "s", full and gap_s < 0.3, note)


async def aborted(personality: Personality, seed: int, folder: Path) -> Row:
    """The operator's abort, ten times: order given to last moving setpoint."""
    async with vehicle(personality) as w, station(w.url) as s:
        await s.follows(w)
        worst_s = 0.0
        for _ in range(10):
            asked_s = s.tell("abort")
            await w.until(lambda: w.holds)
            worst_s = max(worst_s, last_moving_s(w, asked_s))
            await s.does("acknowledge")
            await asyncio.sleep(0.2)
            moving = w.monitor.moving_setpoints
            await s.confirms(w)
            await w.until(lambda moving=moving: w.monitor.moving_setpoints > moving + 5)  # type: ignore[misc]
        return row(w, 0.1, worst_s, "s", w.monitor.external_entries == 11, "abort to the last moving setpoint")


async def full_disk(personality: Personality, seed: int, folder: Path) -> Row:
    """No file may grow beyond 100 kB while recording: the flight goes on."""
    async with vehicle(personality) as w, station(w.url, "--out", str(folder), "--file-limit", "100000") as s:
        await s.follows(w)
        t_s = time.monotonic()
        await asyncio.sleep(4.0)
        gap_s = _longest_gap_s(w.setpoints(t_s))
        s.tell("quit")
        assert await asyncio.wait_for(s.process.wait(), 20) == 0
        problems = [line["said"] for line in s.lines if "record" in line.get("said", "")]
        sizes = sorted(path.stat().st_size for path in folder.iterdir())
        happened = bool(problems) and sizes[-1] <= 100_000
        return row(w, 0.3, gap_s, "s", happened, f"longest setpoint gap; files {sizes}; {'; '.join(problems)[:120]}")


@contextlib.asynccontextmanager
async def camera_process(folder: Path) -> AsyncIterator[tuple[asyncio.subprocess.Process, str, list[float]]]:
    """A simulator of which only the video is used: its process, the address, and where the target stands."""
    truth = folder / "truth.jsonl"
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "sitl_mocks", "--mavlink", f"127.0.0.1:{free_port()}", "--truth", str(truth),
        "--speed", "0.02", "--start-in-air", cwd=ROOT, stdout=asyncio.subprocess.PIPE,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        url = json.loads(await process.stdout.readline())["video_url"]
        while not truth.exists() or truth.read_text().count("\n") < 10:
            await asyncio.sleep(0.1)
        yield process, url, json.loads(truth.read_text().splitlines()[5])["box_px"]
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()


async def camera_gone(personality: Personality, seed: int, folder: Path) -> Row:
    """The process that makes the video is killed: the last moving setpoint after it, then hold."""
    async with contextlib.AsyncExitStack() as stack:
        camera, url, box = await stack.enter_async_context(camera_process(folder))
        w = await stack.enter_async_context(vehicle(personality))
        s = await stack.enter_async_context(station(w.url, "--video", url))
        await s.follows(w, box)
        since = len(s.lines)
        camera.kill()
        kill_s = time.monotonic()
        await s.says(since=since, state="released")
        released_s = time.monotonic() - kill_s
        await w.until(lambda: w.holds)
        await asyncio.sleep(_SETTLE_S)
        happened = any(line.get("state") == "coasting" for line in s.lines[since:])
        note = f"released after {released_s:.2f} s, vehicle in {w.mode.value}"
        return row(w, 1.05, last_moving_s(w, kill_s), "s", happened and released_s < 3.3, note)


async def reborn(personality: Personality, seed: int, folder: Path) -> Row:
    """The vehicle's link dies; 5 s later another autopilot process answers from another port, hovering."""
    async with vehicle(personality) as w, station(w.url) as s:
        await s.follows(w)
        since = len(s.lines)
        await w.stop()
        gone_s = time.monotonic()
        released_s = (await s.says(since=since, state="released"))["t_s"]
        await asyncio.sleep(max(0.0, 5.0 - (time.monotonic() - gone_s)))
        w.mock = MockVehicle(personality, airborne_m=HEIGHT_M, parameters=PREPARED[personality])
        w.heard.clear()
        w.start()
        back_s = time.monotonic()
        await w.until(lambda: any(h.name == "COMMAND_LONG" for h in w.heard))  # its streams are asked for again
        await asyncio.sleep(_SETTLE_S)
        happened = w.mode is not Mode.EXTERNAL and not w.setpoints(back_s)
        await s.does("acknowledge")
        await asyncio.sleep(3.0)
        await s.does("select 0")
        await asyncio.sleep(0.6)
        await s.confirms(w)
        note = "released, silent towards the new one, confirmed again"
        return row(w, 0.6, released_s - gone_s, "s", happened, note)


def _longest_gap_s(setpoints: list[Heard]) -> float:
    return max((b.t_s - a.t_s for a, b in itertools.pairwise(setpoints)), default=math.inf)


FAULTS: dict[str, Fault] = {
    "H21 event loop blocked 2 s": blocked_loop,
    "H22 interpreter lock held 2 s": held_interpreter,
    "H22 SIGSTOP 6 s, SIGCONT": stopped,
    "H23 SIGKILL": killed,
    "H24 SIGTERM": terminated,
    "H22 default executor saturated": saturated,
    "H37 abort": aborted,
    "H35 disk full": full_disk,
    "H1 camera process killed": camera_gone,
    "H10 vehicle on another port": reborn,
}

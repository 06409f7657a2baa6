"""What the page costs a station: first picture, overlay, and how late the 20 Hz tick comes with and without viewers."""

from __future__ import annotations

import asyncio
import gc
import json
import statistics
import sys
import time
from dataclasses import dataclass

from control.gate import TICK_S
from gcs.clock import MonotonicClock
from gcs.operator.config import PageConfig
from gcs.operator.lease import Lease
from gcs.operator.web.server import Page
from tests.page_load.station import LoadStation
from tests.page_load.viewers import look

FPS = 20.0
STAY_S = 2.0  # viewers come before the ticks are counted, and leave after


@dataclass(frozen=True, slots=True)
class Turn:
    """Some seconds with so many viewers. late_ms: of each tick; held_ms: see `Held`; cpu_s: of this process."""

    viewers: int
    late_ms: list[float]
    held_ms: list[float]
    cpu_s: float
    seconds: float
    seen: dict[str, float]


class Held:
    """How long the loop was busy before it looked round again (ms of its thread's own time, whatever else runs here).

    A tick can be kept waiting by the page for as long as that.
    """

    def __init__(self) -> None:
        self.ms: list[float] = []
        selector = asyncio.get_running_loop()._selector  # type: ignore[attr-defined]
        select, since_s = selector.select, time.thread_time()

        def timed(timeout: float | None = None) -> object:
            nonlocal since_s
            self.ms.append((time.thread_time() - since_s) * 1000)
            ready = select(timeout)
            since_s = time.thread_time()
            return ready

        selector.select = timed
        self.end = lambda: setattr(selector, "select", select)


class Rig:
    """A page on a free port with a running station."""

    def __init__(self, size: tuple[int, int]) -> None:
        self.station = LoadStation(size)
        self.page = Page(PageConfig(port=0, most_viewers=100), MonotonicClock(), lease=Lease())

    async def __aenter__(self) -> Rig:
        await self.page.open()
        self.page.attach(self.station)
        gc.collect()
        gc.freeze()  # as a flight does before it flies
        self._running = asyncio.create_task(self.station.run(FPS))
        return self

    async def __aexit__(self, *_: object) -> None:
        self._running.cancel()
        await self.page.close()


async def ticks(seconds: float) -> list[float]:
    """How late each tick of a flight's pace is (ms)."""
    late_ms: list[float] = []
    due_s = start_s = time.monotonic()
    while due_s - start_s < seconds:
        now_s = time.monotonic()
        late_ms.append((now_s - due_s) * 1000)
        due_s = due_s + TICK_S if due_s + TICK_S > now_s else now_s + TICK_S
        await asyncio.sleep(max(due_s - time.monotonic(), 0.0))
    return late_ms


async def turn(rig: Rig, viewers: int, seconds: float, pictures: bool = True) -> Turn:
    """Ticks while so many look on, from another process."""
    process = None
    if viewers:
        flags = [] if pictures else ["--no-pictures"]
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "tests.page_load.viewers", rig.page.url, "--count", str(viewers),
            "--seconds", str(seconds + STAY_S), *flags, stdout=asyncio.subprocess.PIPE,
        )  # fmt: skip
        while len(rig.page._audience) < viewers:
            await asyncio.sleep(0.05)
        await asyncio.sleep(0.5)
    cpu_s, held = time.process_time(), Held()
    late_ms = await ticks(seconds)
    cpu_s = time.process_time() - cpu_s
    held.end()
    seen = json.loads((await process.communicate())[0]) if process is not None else {}
    return Turn(viewers, late_ms, held.ms, cpu_s, seconds, seen)


async def first_picture_s(rig: Rig, times: int = 20) -> list[float]:
    """From the click on the link to the first picture, in this process: link, page, WebSocket, JPEG."""
    return [(await look(rig.page.url, 0.3))["first_s"] for _ in range(times)]


def overlay_us(rig: Rig, lookers: int, times: int = 2000) -> float:
    """One frame's text made and handed to so many viewers that never send it."""

    class Looker:
        wants_picture = wants_candidates = False
        text, name = b"", "page"

        def put(self, kind: str, data: bytes) -> None:
            self.text = data

    stage = rig.page._stage
    assert stage is not None
    sighting = rig.station.show()
    audience = stage.feed._audience
    audience._lookers = [Looker() for _ in range(lookers)]  # type: ignore[misc]
    start_s = time.perf_counter()
    for _ in range(times):
        stage.feed.saw(sighting)
    spent_s = time.perf_counter() - start_s
    audience._lookers = []
    return spent_s / times * 1e6


def centile(values: list[float], percent: float) -> float:
    """Of these, the nearest."""
    return sorted(values)[min(len(values) - 1, round(len(values) * percent / 100))]


async def measure(size: tuple[int, int], seconds: float, rounds: int) -> None:
    """Print it all for one size; turns with and without viewers alternate, so that a busy machine is busy for both."""
    width_px, height_px = size
    print(f"\n{width_px}x{height_px} px, {FPS:g} fps")
    async with Rig(size) as rig:
        first = await first_picture_s(rig)
        print(
            f"  link to first picture     p50 {statistics.median(first) * 1e3:6.0f} ms  most {max(first) * 1e3:.0f} ms"
        )
        print(
            f"  overlay, a frame          1 viewer {overlay_us(rig, 1):.0f} us, 10 viewers {overlay_us(rig, 10):.0f} us"
        )
        turns: list[Turn] = []
        for _ in range(rounds):
            turns += [await turn(rig, 0, seconds), await turn(rig, 10, seconds, False), await turn(rig, 10, seconds)]
        alone = [late for one in turns[0::3] for late in one.late_ms]
        for some, name in (turns[0::3], "nobody"), (turns[1::3], "10, texts only"), (turns[2::3], "10 with pictures"):
            print(f"  tick late, {name:16} {row(some, alone)}")


def row(turns: list[Turn], alone: list[float]) -> str:
    """Lateness of these, compared with what it is with nobody there; and what it costs."""
    late = [late for one in turns for late in one.late_ms]
    p99, more_ms = centile(late, 99), centile(late, 99) - centile(alone, 99)
    cores = sum(one.cpu_s for one in turns) / sum(one.seconds for one in turns)
    held = [held for one in turns for held in one.held_ms]
    times = f"p50 {centile(late, 50):5.2f}  p99 {p99:5.2f} ({more_ms:+.2f} ms, x{p99 / centile(alone, 99):.1f})"
    times += f"  loop held p99.9 {centile(held, 99.9):.2f} most {max(held):.2f} ms  {cores:.3f} core"
    pictures = sum(one.seen.get("pictures", 0) for one in turns)
    if pictures < len(turns) * 2:
        return times
    size_kb = sum(one.seen["bytes"] for one in turns) / pictures / 1000
    rate_hz = pictures / sum(one.seconds + STAY_S for one in turns)
    return f"{times}  each got {rate_hz:.1f}/s of {size_kb:.0f} kB"

"""A whole flight in front of a browser: mock vehicle, rendered camera, and `gcs run` as a process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

from sitl_mocks import scenario
from sitl_mocks.monitor.wire_monitor import WireMonitor
from sitl_mocks.simulator import Simulator, SimulatorConfig
from sitl_mocks.vehicle import PREPARED, Personality
from tests.browser.conftest import drag, reads
from tests.gcs.wire_peer import free_port

CONFIG = """
camera: {hfov_deg: 70, mount_rpy_deg: [0, -28, 0], glass_delay_s: 0.1}
control: {limits: {fence: {radius_m: 400}}}
"""
CIRCLES = {
    "text": "A red car that goes round in circles.",
    "height_m": 9,
    "actors": [
        {"name": "target", "kind": "car", "colour": "red", "start": [16, -4, 0],
         "path": [{"turn_deg": 350, "radius_m": 5}] * 200, "speed": [[0, 0], [8, 0], [10, 2]]}
    ],
}  # fmt: skip


@dataclass
class Flown:
    """setpoints: each that reached the vehicle, (monotonic s, whether it was zero)."""

    simulator: Simulator
    truth: Path
    url: str
    process: asyncio.subprocess.Process
    setpoints: list[tuple[float, bool]] = field(default_factory=list)
    said: list[str] = field(default_factory=list)

    @property
    def monitor(self) -> dict[str, Any]:
        return self.simulator._monitor.summary()

    def box_px(self) -> tuple[float, float, float, float]:
        """Of the target in the newest picture: x, y, w, h."""
        x, y, w, h = json.loads(self.truth.read_text().splitlines()[-1])["box_px"]
        return x, y, w, h

    def zero_after(self, t_s: float) -> float | None:
        """When the first setpoint of zero reached the vehicle after t_s; None: not yet."""
        return next((at_s for at_s, still in self.setpoints if still and at_s >= t_s), None)


@contextlib.asynccontextmanager
async def flown(folder: Path, *arguments: str, scene: str | None = None, fps: float = 10.0) -> AsyncIterator[Flown]:
    """In the air, seen, not yet selected. arguments: more of them for `gcs run`. scene: None is a car in circles."""
    truth, stop, circles = folder / "truth.jsonl", asyncio.Event(), folder / "circles.json"
    circles.write_text(json.dumps(CIRCLES))
    config = SimulatorConfig(
        scenario.load(scene or str(circles)), ("127.0.0.1", free_port()), Personality.PX4, fps=fps, start_in_air=True,
        truth_file=truth, parameters=PREPARED[Personality.PX4],
    )  # fmt: skip
    (folder / "config.yaml").write_text(CONFIG)
    simulator = Simulator(config)
    ready: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
    running = asyncio.create_task(simulator.run(stop, ready.set_result))
    said = await ready
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "tests.gcs.run_blob", "run", "--port", "0", "--config", str(folder / "config.yaml"),
        "--video", said["video_url"], "--vehicle", said["mavlink"], "--out", str(folder / "out"), *arguments,
        stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        url = ""
        while not url:
            line = (await process.stdout.readline()).decode()
            assert line, "gcs run has ended"
            url = line.removeprefix("page: ").strip() if line.startswith("page: ") else ""
        flight = Flown(simulator, truth, url, process)
        reading = asyncio.create_task(_listen(process.stdout, flight.said))
        with _tapped(flight):
            yield flight
        reading.cancel()
    except BaseException:
        print(*flight.said, sep="\n")  # shown with the failure
        raise
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.terminate()
        await process.wait()
        stop.set()
        await running


async def _listen(stream: asyncio.StreamReader, said: list[str]) -> None:
    while line := await stream.readline():
        said.append(line.decode().rstrip())


@contextlib.contextmanager
def _tapped(flight: Flown) -> Iterator[None]:
    """Note each setpoint as the judge on the wire sees it."""
    judge = WireMonitor._check_bound

    def noted(monitor: WireMonitor, seen: Any) -> None:
        flight.setpoints.append((seen.t_s, seen.still))
        judge(monitor, seen)

    with patch.object(WireMonitor, "_check_bound", noted):
        yield


async def draw_target(flight: Flown, page: Any) -> None:
    """A box round the target as it is now, and the answer to it."""
    x, y, w, h = flight.box_px()
    await page.evaluate("document.getElementById('says').replaceChildren()")
    await drag(page, (x, y), (x + w, y + h))
    await page.locator("#says", has_text="to follow").wait_for()
    await reads(page, "state", "SELECTED")


async def hold_follow(page: Any) -> None:
    """F, until the ring is full."""
    await page.wait_for_selector("#follow:not(:disabled)")
    ring = page.locator("#ring")
    await page.keyboard.down("f")
    try:
        await ring.wait_for(state="visible")
        await ring.wait_for(state="hidden")
    finally:
        await page.keyboard.up("f")
    await reads(page, "state", "FOLLOWING")

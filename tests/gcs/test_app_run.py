"""`gcs run` as a user starts it: a process with pipes, a simulator at the other end, signals."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
import sys
import time
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from gcs.keys import SigningKey, write_key
from gcs.recorder.manifest import read_manifest
from gcs.recorder.message_log import read_messages
from sitl_mocks import scenario
from sitl_mocks.simulator import Simulator, SimulatorConfig
from sitl_mocks.vehicle import PREPARED, Mode, Personality
from tests.gcs.wire_peer import free_port

pytestmark = pytest.mark.alone  # real flights in real time want the machine to themselves


@dataclass
class World:
    """A simulator in this process: its insides can be looked at."""

    simulator: Simulator
    video_url: str
    vehicle_url: str
    truth: Path

    def box(self) -> str:
        """The newest true box as the `box` order takes it."""
        row = json.loads(self.truth.read_text().splitlines()[-1])
        return "box " + " ".join(f"{v:.1f}" for v in row["box_px"])

    @property
    def mode(self) -> Mode:
        mode: Mode = self.simulator._vehicle.autopilot.mode
        return mode

    @property
    def monitor(self) -> dict[str, Any]:
        return self.simulator._monitor.summary()


@contextlib.asynccontextmanager
async def world(folder: Path, signing_key: bytes | None = None) -> AsyncIterator[World]:
    port, truth, stop = free_port(), folder / "truth.jsonl", asyncio.Event()
    config = SimulatorConfig(
        scenario.load("demo"),
        ("127.0.0.1", port),
        Personality.PX4,
        fps=10.0,
        start_in_air=True,
        truth_file=truth,
        parameters=PREPARED[Personality.PX4],
        signing_key=signing_key,
    )
    simulator = Simulator(config)
    ready: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
    running = asyncio.create_task(simulator.run(stop, ready.set_result))
    try:
        said = await ready
        yield World(simulator, said["video_url"], said["mavlink"], truth)
    finally:
        stop.set()
        await running


class Station:
    """A `gcs run` process: what it says, what it is told."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self.process = process
        self.said: list[str] = []

    async def hears(self, *texts: str) -> str:
        """Lines up to one with one of these texts."""
        assert self.process.stdout is not None
        async with asyncio.timeout(40):
            while line := (await self.process.stdout.readline()).decode():
                self.said.append(line.strip())
                if any(text in line for text in texts):
                    return line
        raise AssertionError(f"{texts} were never said: {self.said}")

    async def confirms(self) -> None:
        """Once more where the machine was busy a moment ago, which refuses it for two seconds."""
        self.tell("follow")
        if "late" in await self.hears("confirmed", "not following"):
            await asyncio.sleep(2.5)
            self.tell("follow")
            await self.hears("confirmed")

    def tell(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(line.encode() + b"\n")


@contextlib.asynccontextmanager
async def station(*arguments: str) -> AsyncIterator[Station]:
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "tests.gcs.run_blob", "run", "--port", "0", *arguments,
        stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
    )  # fmt: skip
    try:
        yield Station(process)
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


async def page_status(s: Station) -> dict[str, Any]:
    """What the page shows, fetched by the link that was said."""
    url = next(line.removeprefix("page: ") for line in s.said if line.startswith("page: "))

    async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as browser:
        async with browser.get(url) as answer:
            assert answer.status == 200
        async with browser.get(url.partition("?")[0] + "status.json") as answer:
            status: dict[str, Any] = await answer.json()
            return status


def camera_file(folder: Path) -> Path:
    path = folder / "config.yaml"
    path.write_text(
        "camera: {hfov_deg: 70, mount_rpy_deg: [0, -28, 0], glass_delay_s: 0.1}\n"
        f"recorder: {{folder: {folder / 'flights'}}}\n"
    )
    return path


@pytest.fixture
def hangs_up() -> Iterator[None]:
    """Processes inherit what nohup would ignore, and `gcs run` then goes on, as whoever starts it so wants."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.usefixtures("hangs_up")
@pytest.mark.parametrize(("number", "signed"), [(signal.SIGHUP, False), (signal.SIGTERM, True)])
async def test_a_signal_brings_zero_hold_and_exit(tmp_path: Path, number: signal.Signals, signed: bool) -> None:
    key = SigningKey.random()
    write_key(tmp_path / "signing.key", key)
    async with world(tmp_path, key.secret if signed else None) as w:
        arguments = ["--video", w.video_url, "--vehicle", w.vehicle_url, "--config", str(camera_file(tmp_path))]
        arguments += ["--signing-key", str(tmp_path / "signing.key")] if signed else []
        async with station(*arguments) as s:
            assert (f"signed link, key {key.fingerprint}" if signed else "unsigned link") in await s.hears(
                "vehicle: PX4"
            )
            await s.hears("IDLE")
            s.tell("follow")
            assert "no target is selected" in await s.hears("not following")
            await asyncio.sleep(2.5)
            s.tell(w.box())
            await s.hears("selected")
            await asyncio.sleep(0.6)
            await s.confirms()
            await asyncio.sleep(1.0)
            assert (await page_status(s))["state"] == "following"
            assert w.mode is Mode.EXTERNAL
            assert w.monitor["moving_setpoints"] > 0
            t_signal_s = time.monotonic()
            s.process.send_signal(number)
            assert await asyncio.wait_for(s.process.wait(), 20) == 0
            assert w.mode is Mode.HOLD
            assert w.monitor["last_moving_setpoint_t_s"] < t_signal_s + 0.3
            assert w.monitor["unsafe"] == 0, w.monitor["reasons"]
    (out,) = (tmp_path / "flights").iterdir()
    for name in ("messages.jsonl", "film.mjpeg", "flight.tlog"):
        assert (out / name).stat().st_size > 1000
    manifest = read_manifest(out)
    assert (manifest.kind, manifest.vehicle, manifest.follows, manifest.problems) == ("run", w.vehicle_url, 1, ())
    assert manifest.video is not None
    assert manifest.video.address == w.video_url
    figures = [r.data for r in read_messages(out / "messages.jsonl") if r.type == "LinkFigures"]
    assert len(figures) > 3  # one a second
    assert figures[-1]["received_bytes_per_s"] > figures[-1]["sent_bytes_per_s"] > 0
    assert key.secret.hex() not in "".join(s.said)


async def test_no_vehicle_is_one_line_and_exit_2(tmp_path: Path) -> None:
    async with world(tmp_path) as w:
        nobody = f"udpin://127.0.0.1:{free_port()}"
        out = tmp_path / "out"
        async with station("--video", w.video_url, "--vehicle", nobody, "--timeout", "0.5", "--out", str(out)) as s:
            _, said = await s.process.communicate()
            assert s.process.returncode == 2
            assert said.decode().startswith(f"gcs: no vehicle at {nobody} within 0.5 s")
            assert said.count(b"\n") == 1
        (problem,) = read_manifest(out).problems  # what was seen and heard is kept
        assert problem.startswith("no vehicle at")


async def test_recorded_video_never_flies(tmp_path: Path) -> None:
    from sitl_mocks import sequences

    clip = sequences.path(sequences.names()[0])
    async with station("--video", str(clip), "--vehicle", f"udpin://127.0.0.1:{free_port()}") as s:
        _, said = await s.process.communicate()
        assert s.process.returncode == 2
        assert b"recorded video" in said
        assert said.count(b"\n") == 1

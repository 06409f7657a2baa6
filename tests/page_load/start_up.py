"""`python -m tests.page_load.start_up`: how soon `gcs run` answers, and what it costs while nobody looks.

Against `gcs sim` with the real tracker: from the start of the process to the first answer of its page (nothing of
PyTorch is loaded by then), to the station behind it (all of it is), and processor time with video, no viewer and
nothing selected.
"""

from __future__ import annotations

import asyncio
import os
import statistics
import sys
import tempfile
import time
from pathlib import Path

import aiohttp

from tests.gcs.wire_peer import free_port

RUNS = 5
IDLE_S = 30.0


async def main() -> None:
    """Print the medians."""
    mavlink, video = f"127.0.0.1:{free_port()}", free_port()
    sim = await _start("sim", "--in-air", "--mavlink", mavlink, "--video-port", str(video))
    await _line(sim, "another terminal")
    arguments = ["--vehicle", f"udpin://{mavlink}", "--video", f"http://127.0.0.1:{video}/video", "--profile", "sim"]
    try:
        with tempfile.TemporaryDirectory() as name:
            runs = [await _run([*arguments, "--out", str(Path(name) / str(i))], i == RUNS - 1) for i in range(RUNS)]
            quiet = Path(name) / "quiet.yaml"
            quiet.write_text("recorder: {video: false}\n")
            unfilmed = await _run([*arguments, "--out", name, "--config", str(quiet)], True)
    finally:
        sim.terminate()
        await sim.wait()
    answers, ready, _ = zip(*runs, strict=True)
    print(f"page answers after {statistics.median(answers):.2f} s (worst {max(answers):.2f}), no PyTorch yet")
    print(
        f"station behind it after {statistics.median(ready):.2f} s (worst {max(ready):.2f}), PyTorch and weights loaded"
    )
    print(f"video, no viewer, nothing selected: {runs[-1][2]:.3f} of a core filming, {unfilmed[2]:.3f} not filming")


async def _run(arguments: list[str], idle: bool) -> tuple[float, float, float]:
    """Seconds to the page's answer, to its station; share of a core while idle."""
    port, start_s = free_port(), time.monotonic()
    process = await _start("run", "--port", str(port), "--plain", *arguments)
    reading = asyncio.create_task(_line(process, "page: "))
    async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as browser:
        answered_s = await _until(browser, f"http://127.0.0.1:{port}/", 401) - start_s
        url = (await reading).partition("page: ")[2].strip()
        rest = asyncio.create_task(_drain(process))
        ready_s = await _until(browser, url.replace("/?", "/snapshot.jpg?"), 200) - start_s
    share = await _idle(process.pid) if idle else 0.0
    process.terminate()
    await process.wait()
    await rest
    return answered_s, ready_s, share


async def _idle(pid: int) -> float:
    await asyncio.sleep(5.0)
    before_s, start_s = _cpu_s(pid), time.monotonic()
    await asyncio.sleep(IDLE_S)
    return (_cpu_s(pid) - before_s) / (time.monotonic() - start_s)


def _cpu_s(pid: int) -> float:
    """User and system time so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


async def _until(browser: aiohttp.ClientSession, url: str, status: int) -> float:
    """When it is first answered so."""
    while True:
        try:
            async with browser.get(url) as answer:
                if answer.status == status:
                    return time.monotonic()
        except aiohttp.ClientConnectionError:
            pass
        await asyncio.sleep(0.01)


async def _start(*arguments: str) -> asyncio.subprocess.Process:
    return await asyncio.create_subprocess_exec(
        sys.executable, "-m", "gcs.cli", *arguments,
        stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE,
    )  # fmt: skip


async def _line(process: asyncio.subprocess.Process, text: str) -> str:
    assert process.stdout is not None
    while line := (await process.stdout.readline()).decode():
        if text in line:
            return line
    raise SystemExit(f"it ended before it said {text!r}")


async def _drain(process: asyncio.subprocess.Process) -> None:
    assert process.stdout is not None
    await process.stdout.read()


if __name__ == "__main__":
    asyncio.run(main())

"""`python -m tests.browser.pictures [FOLDER]`: the pictures of the guides, of a flight that is flown for them.

`gcs sim` and `gcs run --profile sim` are flown by the page in Chromium, with the tracker that ships; the terminal's is
what tmux shows of the same flight. Then `gcs dry-run --sample --page`, and `gcs replay` and `gcs report` of a demo.
Needs Chromium and tmux, and a machine that does nothing else.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
import socket
import subprocess
import sys
import tempfile
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from playwright.async_api import async_playwright
from rich.console import Console
from rich.terminal_theme import TerminalTheme
from rich.text import Text

from tests.browser.conftest import ARGS, LAPTOP, chromium, drag, reads
from tests.browser.flight import hold_follow
from tests.gcs.wire_peer import free_port

GCS = (sys.executable, "-m", "gcs.cli")
PHONE = {"width": 390, "height": 844}
MOST_BYTES = 120_000
COLUMNS, ROWS = 80, 24
STARTED_S, STEADY_S, STEPPED_S = 60.0, 1.0, 0.4
DEMO_S = 30
THEME = TerminalTheme(
    (12, 12, 12), (217, 217, 217),
    [(12, 12, 12), (197, 15, 31), (16, 124, 16), (193, 156, 0),
     (0, 55, 218), (136, 23, 152), (58, 150, 221), (204, 204, 204)],
)  # fmt: skip
_URL = re.compile(r"http://\S+\?token=\S+")


class Terminals:
    """Programs in terminals of tmux, on a server of its own."""

    def __init__(self, name: str) -> None:
        self._tmux = ("tmux", "-L", name, "-f", "/dev/null")

    def start(self, name: str, *command: str) -> None:
        """In a terminal of that name, which stays when the command has ended."""
        size = ("-x", str(COLUMNS), "-y", str(ROWS))
        self._do("new-session", "-d", "-s", name, *size, *command, ";", "set", "-t", name, "remain-on-exit", "on")

    def shown(self, name: str) -> str:
        """What stands there, with its colours."""
        return self._do("capture-pane", "-e", "-p", "-t", name)

    def interrupt(self, name: str) -> None:
        """Ctrl-C."""
        self._do("send-keys", "-t", name, "C-c")

    def close(self) -> None:
        """Everything."""
        subprocess.run((*self._tmux, "kill-server"), check=False, capture_output=True)

    def _do(self, *words: str) -> str:
        return subprocess.run((*self._tmux, *words), check=True, capture_output=True, text=True).stdout


@contextlib.asynccontextmanager
async def flying(folder: Path) -> AsyncIterator[Terminals]:
    """Simulator and station, as the guide starts them but for their ports."""
    mavlink, video = f"127.0.0.1:{free_port()}", str(free_port(socket.SOCK_STREAM))
    terminals = Terminals(f"pictures-{video}")
    try:
        terminals.start("sim", *GCS, "sim", "--mavlink", mavlink, "--video-port", video)
        await shows(terminals, "sim", re.compile("In another terminal"))
        terminals.start(
            "run", *GCS, "run", "--profile", "sim", "--port", "0", "--out", str(folder / "run"),
            "--vehicle", f"udpin://{mavlink}", "--video", f"http://127.0.0.1:{video}/video",
        )  # fmt: skip
        yield terminals
        terminals.interrupt("run")
    except BaseException:
        print(Text.from_ansi(terminals.shown("sim") + terminals.shown("run")).plain)
        raise
    finally:
        terminals.close()


async def shows(terminals: Terminals, name: str, text: re.Pattern[str]) -> str:
    """What fits, once it stands there."""
    async with asyncio.timeout(STARTED_S):
        while (found := text.search(terminals.shown(name))) is None:
            await asyncio.sleep(0.2)
    return found[0]


async def opened(browser: Any, url: str, size: dict[str, int], **options: Any) -> Any:
    """A browser at the page, with a picture in it."""
    context = await browser.new_context(viewport=size, **options)
    page = await context.new_page()
    await page.goto(url)
    await page.locator("#state", has_text=re.compile("IDLE|SELECTED|FOLLOWING")).wait_for(timeout=1000 * STARTED_S)
    return page


async def keep(page: Any, path: Path) -> None:
    """A JPEG of what the page shows, as good as may be."""
    for quality in (85, 75, 65, 55, 45):
        jpeg = await page.screenshot(type="jpeg", quality=quality)
        if len(jpeg) <= MOST_BYTES:
            break
    path.write_bytes(jpeg)
    print(f"{path}: {len(jpeg) / 1000:.0f} kB")


async def hold(page: Any, selector: str) -> None:
    """A button that wants a second."""
    await page.locator(selector).hover()
    await page.mouse.down()
    await asyncio.sleep(1.3)
    await page.mouse.up()


async def steady(page: Any, state: str) -> None:
    """That state, and for a moment no other."""
    async with asyncio.timeout(STARTED_S):
        while True:
            await reads(page, "state", state)
            await asyncio.sleep(STEADY_S)
            if await page.locator("#state").text_content() == state:
                return


async def red_car(page: Any) -> tuple[float, float, float, float]:
    """Left, top, right, bottom of the largest thing in the picture that is as red as the scenario's car."""
    answer = await page.context.request.get(page.url + "snapshot.jpg")
    picture = cv2.imdecode(np.frombuffer(await answer.body(), np.uint8), cv2.IMREAD_COLOR)
    red = cv2.inRange(picture, (0, 0, 110), (80, 80, 255))
    red = cv2.morphologyEx(red, cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
    _, _, stats, _ = cv2.connectedComponentsWithStats(red)
    x, y, w, h, _ = max(stats[1:], key=lambda row: row[cv2.CC_STAT_AREA])
    return float(x), float(y), float(x + w), float(y + h)


async def take_off(page: Any) -> None:
    """By the drawer, and it is closed again."""
    await page.keyboard.press("d")
    await hold(page, "button[data-do=takeoff]")
    await page.locator("#says", has_text=re.compile(r"at \d")).wait_for(timeout=1000 * STARTED_S)
    if await page.locator("#drawer").is_visible():
        await page.keyboard.press("d")


async def under_way(page: Any) -> None:
    """The car drives, and it is followed."""
    async with asyncio.timeout(STARTED_S):
        while float((await page.locator("#speed").text_content()).strip("–") or 0) < 2.5:
            await asyncio.sleep(0.2)
    await asyncio.sleep(2.0)
    await steady(page, "FOLLOWING")


async def terminal(browser: Any, shown: str, path: Path) -> None:
    """What a terminal shows, as a picture."""
    console = Console(record=True, width=COLUMNS, file=open("/dev/null", "w"), legacy_windows=False)  # noqa: SIM115
    console.print(Text.from_ansi(shown.rstrip("\n")))
    page = await (await browser.new_context(viewport={"width": 800, "height": 480})).new_page()
    await page.set_content(console.export_html(theme=THEME, inline_styles=True))
    await page.add_style_tag(content="html,body,pre{background:#0c0c0c;margin:0} pre{padding:12px}")
    size = await page.locator("pre").bounding_box()
    await page.set_viewport_size({"width": int(size["width"]) + 1, "height": int(size["height"]) + 1})
    await keep(page, path)
    await page.context.close()


async def flight(browser: Any, folder: Path) -> None:
    """Idle, following on a laptop, in the terminal and on a phone, and aborted."""
    with tempfile.TemporaryDirectory() as name:
        async with flying(Path(name)) as terminals:
            await _flown(browser, folder, terminals)


async def _flown(browser: Any, folder: Path, terminals: Terminals) -> None:
    """The flight itself."""
    url = await shows(terminals, "run", _URL)
    page = await opened(browser, url, LAPTOP)
    await take_off(page)
    await asyncio.sleep(STEADY_S)
    await keep(page, folder / "simulator-idle.jpg")
    left, top, right, bottom = await red_car(page)
    await drag(page, (left, top), (right, bottom))
    await reads(page, "state", "SELECTED")
    await hold_follow(page)
    await under_way(page)
    await keep(page, folder / "simulator-following.jpg")
    await terminal(browser, terminals.shown("run"), folder / "simulator-terminal.jpg")
    phone = await opened(browser, url, PHONE, has_touch=True, is_mobile=True)
    for _ in range(2):  # the first tap asks whether it is meant
        await phone.locator("#take").tap()
        await asyncio.sleep(0.4)
    await asyncio.sleep(9.5)  # what it says of that has faded
    await steady(phone, "FOLLOWING")
    await keep(phone, folder / "simulator-phone.jpg")
    await asyncio.sleep(6.0)  # past the bridge
    await steady(page, "FOLLOWING")
    await page.keyboard.press("Space")  # by who only looks on
    await reads(page, "state", "RELEASED")
    await asyncio.sleep(1.5)  # it has braked, and is level again
    await keep(page, folder / "simulator-aborted.jpg")
    await phone.context.close()
    await page.context.close()


@contextlib.asynccontextmanager
async def paged(*command: str) -> AsyncIterator[str]:
    """A command of gcs that shows a page, and where."""
    process = await asyncio.create_subprocess_exec(
        *GCS, *command, "--port", "0", stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
    )
    try:
        assert process.stdout is not None
        while (found := _URL.search((await process.stdout.readline()).decode())) is None:
            assert not process.stdout.at_eof(), f"{command[0]} has ended"
        yield found[0]
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.terminate()
        await process.wait()


async def dry_run(browser: Any, folder: Path) -> None:
    """A recording that plays; its first box comes with it."""
    with tempfile.TemporaryDirectory() as name:
        async with paged("dry-run", "--sample", "--page", "--out", name) as url:
            page = await opened(browser, url, LAPTOP)
            await hold_follow(page)
            await asyncio.sleep(3.0)
            await steady(page, "FOLLOWING")
            await keep(page, folder / "dry-run-page.jpg")
            await page.context.close()


async def is_hidden(page: Any, pictures: int = 0) -> bool:
    """Whether a replay's target is not seen, after so many pictures more."""
    for _ in range(pictures):
        await page.keyboard.press(".")
        await asyncio.sleep(STEPPED_S)
    return str(await page.locator("#state").text_content()).startswith(("COASTING", "LOST"))


async def looked_back(browser: Any, folder: Path) -> None:
    """A demo in which the target hides for a while: played again at that moment, and its report."""
    with tempfile.TemporaryDirectory() as name:
        options = "--scenario", "occlusion", "--seconds", str(DEMO_S), "--no-page", "--out", f"{name}/demo"
        subprocess.run((*GCS, "demo", *options), check=True, stdout=subprocess.DEVNULL)
        async with paged("replay", f"{name}/demo") as url:
            page = await opened(browser, url, LAPTOP)
            await page.keyboard.press("Space")
            async with asyncio.timeout(STARTED_S):
                while not (await is_hidden(page) and await is_hidden(page, pictures=6)):
                    await page.keyboard.press("n")
                    await asyncio.sleep(STEPPED_S)
            await keep(page, folder / "replay.jpg")
            await page.context.close()
        subprocess.run((*GCS, "report", f"{name}/demo"), check=True, stdout=subprocess.DEVNULL)
        page = await (await browser.new_context(viewport=LAPTOP)).new_page()
        await page.goto((Path(name) / "demo" / "report.html").as_uri())
        await keep(page, folder / "report.jpg")
        await page.context.close()


async def make(folder: Path) -> None:
    """All of them."""
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=chromium(), args=list(ARGS))
        await dry_run(browser, folder)
        await flight(browser, folder)
        await looked_back(browser, folder)
        await browser.close()


if __name__ == "__main__":
    asyncio.run(make(Path(sys.argv[1] if len(sys.argv) > 1 else "docs")))

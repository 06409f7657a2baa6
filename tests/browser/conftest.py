"""A real page server with a scripted station, and the Chromium that is installed, driven by Playwright."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

import pytest
import pytest_asyncio

from gcs.clock import MonotonicClock
from gcs.operator.config import PageConfig
from gcs.operator.lease import Lease
from gcs.operator.web.server import Page as Served
from tests.gcs.fake_station import FakeStation

playwright_api = pytest.importorskip(
    "playwright.async_api", reason="Playwright is not installed (pip install -e .[dev])"
)

PATIENCE_MS = 10_000  # of every step in the browser; nothing waits so long unless it is broken
ARGS = (
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
)  # fmt: skip
LAPTOP = {"width": 1366, "height": 768}


def chromium() -> str | None:
    """Which browser."""
    names = ("chromium", "chromium-browser", "google-chrome")
    return os.environ.get("CHROMIUM") or next((path for name in names if (path := shutil.which(name))), None)


@pytest_asyncio.fixture(scope="session", loop_scope="session")
async def browser() -> AsyncIterator[Any]:
    """One for the whole run; every test has contexts of its own in it."""
    path = chromium()
    if path is None:
        pytest.skip("no Chromium found: install it, or name it in CHROMIUM")
    async with playwright_api.async_playwright() as playwright:
        launched = await playwright.chromium.launch(executable_path=path, args=list(ARGS))
        yield launched
        await launched.close()


@dataclass
class Desk:
    """The station with its page, and browsers in front of it."""

    browser: Any
    served: Served
    station: FakeStation
    contexts: list[Any]
    running: asyncio.Task[None]

    async def freeze(self) -> None:
        """No more pictures but those that the test shows."""
        self.running.cancel()
        await asyncio.wait([self.running])

    async def show(self, page: Any) -> int:
        """One more picture, and wait until it is on the screen; its number."""
        seq = self.station.show().seen.frame.seq
        await page.wait_for_selector(f"#picture[data-frame='{seq}']")
        return seq

    async def open(
        self,
        size: dict[str, int] = LAPTOP,
        *,
        prepare: Callable[[Any], Awaitable[None]] | None = None,
        wait: bool = True,
        **options: Any,
    ) -> Any:
        """Another browser, at the page; waits for the first picture. prepare: before the page is asked for."""
        context = await self.browser.new_context(viewport=size, **options)
        self.contexts.append(context)
        context.set_default_timeout(PATIENCE_MS)
        page = await context.new_page()
        page.errors = []
        page.on("pageerror", lambda error: page.errors.append(str(error)))
        page.on("console", lambda line: page.errors.append(line.text) if _is_fault(line) else None)
        if prepare is not None:
            await prepare(page)
        await page.goto(self.served.url)
        if wait:
            await page.wait_for_selector("#picture[data-frame]:not([data-frame=''])")
            await reads(page, "vehicle-mode", re.compile(r"\w"))
        return page

    async def until(self, is_so: Callable[[], object]) -> None:
        """Something in the station has come true."""
        async with asyncio.timeout(PATIENCE_MS / 1000):
            while not is_so():
                await asyncio.sleep(0.01)

    def given(self, kind: type[Any]) -> list[Any]:
        """The orders of this kind that the station got."""
        return [order for order in self.station.orders if isinstance(order, kind)]


class Cable:
    """The WebSocket's way, to be cut or to go dead; POST has its own."""

    def __init__(self) -> None:
        self.is_cut = self.is_dead = False
        self._ends: list[Any] = []

    async def plug(self, page: Any) -> None:
        await page.route_web_socket("**/ws", self._joined)

    async def _joined(self, socket: Any) -> None:
        if self.is_cut:
            await socket.close()
            return
        server = socket.connect_to_server()
        socket.on_message(lambda message: None if self.is_dead else server.send(message))
        server.on_message(lambda message: None if self.is_dead else socket.send(message))
        self._ends.append(socket)

    async def cut(self) -> None:
        self.is_cut = True
        for socket in self._ends:
            await socket.close()
        self._ends.clear()


def _is_fault(line: Any) -> bool:
    """A broken connection is told by the browser too; those are part of the tests."""
    return line.type == "error" and not any(word in line.text for word in ("WebSocket", "ERR_", "status of"))


@asynccontextmanager
async def desk_of(browser: Any, size: tuple[int, int] = (640, 480), **options: Any) -> AsyncIterator[Desk]:
    """Open for as long as the block lasts; faults of the page's own program are failures."""
    served = Served(PageConfig(port=0), MonotonicClock(), lease=Lease())
    await served.open()
    station = FakeStation(size, **options)
    served.attach(station)
    running = asyncio.create_task(station.run(20.0))
    desk = Desk(browser, served, station, [], running)
    try:
        yield desk
        faults = [error for context in desk.contexts for page in context.pages for error in page.errors]
        assert not faults
    finally:
        for context in desk.contexts:
            await context.close()
        running.cancel()
        await served.close()


@pytest_asyncio.fixture(loop_scope="session")
async def desk(browser: Any) -> AsyncIterator[Desk]:
    """640x480 pictures at 20 Hz, marked SIM; nothing selected."""
    async with desk_of(browser) as opened:
        yield opened


async def reads(page: Any, id: str, text: str | re.Pattern[str]) -> None:
    """Wait until it does."""
    await playwright_api.expect(page.locator(f"#{id}")).to_have_text(text, timeout=PATIENCE_MS)


async def select(desk: Desk, page: Any) -> None:
    """A box round the target, with the mouse."""
    await drag(page, (300, 250), (360, 310))
    await reads(page, "state", "SELECTED")
    await page.wait_for_selector("#follow:not(:disabled)")


def place_of(edge: dict[str, float], size: tuple[int, int], x: float, y: float) -> tuple[float, float]:
    """Where in the window a pixel of the picture is: the picture is contained and centred in the canvas."""
    scale = min(edge["width"] / size[0], edge["height"] / size[1])
    left = edge["x"] + (edge["width"] - size[0] * scale) / 2
    top = edge["y"] + (edge["height"] - size[1] * scale) / 2
    return left + x * scale, top + y * scale


async def drag(
    page: Any, start: tuple[float, float], end: tuple[float, float], size: tuple[int, int] = (640, 480)
) -> None:
    """With the mouse, between two pixels of the picture."""
    edge = await page.locator("#picture").bounding_box()
    await page.mouse.move(*place_of(edge, size, *start))
    await page.mouse.down()
    await page.mouse.move(*place_of(edge, size, *((a + b) / 2 for a, b in zip(start, end, strict=True))))
    await page.mouse.move(*place_of(edge, size, *end))
    await page.mouse.up()


async def shot(page: Any, name: str) -> None:
    """A picture of the page into the folder SHOTS, where it is given."""
    folder = os.environ.get("SHOTS")
    if folder:
        await page.screenshot(path=f"{folder}/{name}.png")

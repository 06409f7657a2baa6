"""A page on a real socket with a station that only pretends, and browsers without a window."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
from collections.abc import AsyncIterator

import aiohttp

from gcs.clock import FakeClock
from gcs.operator.config import PageConfig
from gcs.operator.lease import Lease
from gcs.operator.web.server import Page
from tests.gcs.fake_station import FakeStation

TOKEN = "a-token-for-the-tests"
SOON_S = 5.0


class Browser:
    """One WebSocket: asks and waits for the answer; keeps the newest of every other kind it hears."""

    def __init__(self, ws: aiohttp.ClientWebSocketResponse) -> None:
        self.ws = ws
        self.heard: dict[str, dict] = {}
        self.said: list[str] = []
        self.pictures: list[bytes] = []
        self._ids = itertools.count(1)

    async def ask(self, do: str, **more: object) -> dict:
        """The answer to this message."""
        number = next(self._ids)
        await self.ws.send_str(json.dumps({"id": number, "do": do, **more}))
        while (message := await self.hear("answer"))["id"] != number:
            pass
        return message

    async def hear(self, kind: str) -> dict:
        """The next message of this kind."""
        async with asyncio.timeout(SOON_S):
            while (message := await self._read()).get("type") != kind:
                pass
        return message

    async def _read(self) -> dict:
        """The next message; {} for a picture. AssertionError where it was closed."""
        message = await self.ws.receive()
        if message.type is aiohttp.WSMsgType.BINARY:
            self.pictures.append(message.data)
            return {}
        assert message.type is aiohttp.WSMsgType.TEXT, (message.type, self.ws.close_code, message.extra)
        found = json.loads(message.data)
        self.heard[found["type"]] = found
        if found["type"] == "say":
            self.said.append(found["text"])
        return found

    async def picture(self) -> bytes:
        """The next one."""
        had = len(self.pictures)
        async with asyncio.timeout(SOON_S):
            while len(self.pictures) == had:
                await self._read()
        return self.pictures[-1]

    async def end(self) -> tuple[int, str]:
        """Whatever still comes, and then why it was closed."""
        async with asyncio.timeout(SOON_S):
            while True:
                message = await self.ws.receive()
                if message.type is aiohttp.WSMsgType.CLOSE:
                    return message.data, message.extra
                if message.type in (aiohttp.WSMsgType.CLOSED, aiohttp.WSMsgType.ERROR):
                    return self.ws.close_code or 0, ""


class WebRig:
    """The page, its station, and sessions that know the token."""

    def __init__(self, page: Page, station: FakeStation, clock: FakeClock, lease: Lease) -> None:
        self.page, self.station, self.clock, self.lease = page, station, clock, lease
        self.acts: list[tuple[str, str]] = []
        self.stack = contextlib.AsyncExitStack()

    @property
    def base(self) -> str:
        return f"http://127.0.0.1:{self.page.port}"

    async def session(self, *, known: bool = True) -> aiohttp.ClientSession:
        """A browser with the cookie, or without."""
        jar = aiohttp.CookieJar(unsafe=True)  # of an address without a name too
        session = await self.stack.enter_async_context(aiohttp.ClientSession(self.base, cookie_jar=jar))
        if known:
            async with session.get(f"/?token={TOKEN}") as response:
                assert response.status == 200
        return session

    async def browser(self, session: aiohttp.ClientSession | None = None) -> Browser:
        """One that is connected."""
        session = session or await self.session()
        return Browser(await session.ws_connect("/ws", origin=self.base))


@contextlib.asynccontextmanager
async def web_rig(
    *, attached: bool = True, size: tuple[int, int] = (320, 240), **config: object
) -> AsyncIterator[WebRig]:
    """Open; closed again at the end, whatever the browsers do."""
    clock, lease = FakeClock(1000.0), Lease()
    station = FakeStation(size, now_s=clock.now_s)
    page = Page(PageConfig(port=0, token=TOKEN, **config), clock, lease=lease)  # type: ignore[arg-type]
    rig = WebRig(page, station, clock, lease)
    page.on_act = lambda name, text: rig.acts.append((name, text))
    await page.open()
    async with rig.stack:
        if attached:
            page.attach(station)
            station.show()
        try:
            yield rig
        finally:
            await page.close()


def done(rig) -> list[str]:
    return [type(order).__name__ for order in rig.station.orders]


async def select(rig, browser: Browser) -> dict:
    return await browser.ask("select", box=[10, 20, 30, 40], frame=rig.station.frames.newest.seq)


async def held(rig, browser: Browser, held_s: float = 1.0) -> dict:
    assert (await browser.ask("hold_begin"))["ok"]
    rig.clock.advance(held_s)
    return await browser.ask("confirm")

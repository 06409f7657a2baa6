"""WebRTC in a real Chromium: the number told for each presented picture is the one that the picture carries."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import pytest
import pytest_asyncio
from aiohttp import web

from gcs.errors import GcsError
from gcs.operator.web.static_files import FOLDER
from gcs.video_out.peers import Peers
from tests.gcs.numbered import BITS, LEFT_PX, SIDE_PX, TOP_PX, NumberedStation

pytestmark = pytest.mark.asyncio(loop_scope="session")

PAGE = "<!doctype html><title>WebRTC</title><video id=video playsinline></video>"
READ = """
async ({count, bits, left, top, side}) => {
  const { start, stop } = await import("/static/webrtc.js");
  const video = document.getElementById("video"), seen = [];
  const canvas = document.createElement("canvas"), begun = performance.now();
  const pen = canvas.getContext("2d", { willReadFrequently: true });
  return new Promise((resolve, reject) => {
    const timer = setTimeout(() => reject(new Error(`only ${seen.length} pictures`)), 30000);
    const shown = (seq, image) => {
      [canvas.width, canvas.height] = [video.videoWidth, video.videoHeight];
      pen.drawImage(image, 0, 0);
      image.close?.();
      let number = 0;
      for (let bit = 0; bit < bits; bit++) {
        const at = pen.getImageData(left + bit * side + side / 2, top + side / 2, 1, 1).data;
        if (at[1] > 128) number |= 1 << bit;
      }
      seen.push([seq, number, performance.now() - begun, performance.timeOrigin + performance.now()]);
      if (seen.length === count) { clearTimeout(timer); stop(); resolve(seen); }
    };
    start(video, shown, (why) => reject(new Error(why))).catch(reject);
  });
}
"""
ARGUMENTS = {"bits": BITS, "left": LEFT_PX, "top": TOP_PX, "side": SIDE_PX}


class Served:
    """The module alone, without the operator's page."""

    def __init__(self, station: NumberedStation) -> None:
        self.station, self.peers = station, Peers(station)
        app = web.Application()
        app.add_routes([web.get("/", self._page), web.post("/webrtc", self._offer), web.static("/static", FOLDER)])
        self._runner = web.AppRunner(app)

    async def open(self) -> str:
        await self._runner.setup()
        site = web.TCPSite(self._runner, "127.0.0.1", 0)
        await site.start()
        return site.name.replace("127.0.0.1:0", f"127.0.0.1:{self._runner.addresses[0][1]}")

    async def close(self) -> None:
        await self.peers.close_all()
        await self._runner.cleanup()

    async def _page(self, request: web.Request) -> web.Response:
        return web.Response(text=PAGE, content_type="text/html")

    async def _offer(self, request: web.Request) -> web.Response:
        try:
            return web.Response(text=await self.peers.answer(await request.text()))
        except GcsError as error:
            return web.Response(text=str(error), status=400)


@pytest_asyncio.fixture(loop_scope="session")
async def served() -> AsyncIterator[Served]:
    station = NumberedStation(size=(640, 480))
    server = Served(station)
    server.url = await server.open()
    running = asyncio.create_task(station.run(25.0))
    yield server
    running.cancel()
    await server.close()


async def open_page(browser: Any, url: str) -> Any:
    page = await (await browser.new_context()).new_page()
    await page.goto(url)
    return page


async def test_every_presented_picture_is_the_frame_that_is_told(browser, served):
    page = await open_page(browser, served.url)
    seen = await page.evaluate(READ, {"count": 150, **ARGUMENTS})
    wrong = [(seq, number) for seq, number, *_ in seen if seq != number]
    assert not wrong
    assert len({seq for seq, *_ in seen}) > 100
    await page.context.close()


async def test_several_browsers_share_one_encoder_and_are_forgotten_when_they_leave(browser, served):
    pages = [await open_page(browser, served.url) for _ in range(3)]
    found = await asyncio.gather(*(page.evaluate(READ, {"count": 25, **ARGUMENTS}) for page in pages))
    assert all(seq == number for seen in found for seq, number, *_ in seen)
    assert len(served.station.watchers) == 1  # one stream, whoever takes it
    for page in pages:
        await page.context.close()
    async with asyncio.timeout(40):
        while served.peers.count:
            await asyncio.sleep(0.1)


async def test_what_cannot_be_served_is_said(browser, served):
    page = await open_page(browser, served.url)
    asked = """async () => { const { start } = await import("/static/webrtc.js");
      window.fetch = async () => new Response("no room", { status: 400 });
      return start(document.getElementById("video"), () => {}).then(() => "", (error) => error.message); }"""
    assert await page.evaluate(asked) == "no room"
    await page.context.close()


async def test_the_page_shows_it_and_takes_the_numbers_for_its_overlay(desk):
    page = await desk.open()
    await page.keyboard.press("v")
    await page.wait_for_selector("#webrtc[aria-pressed=true]", state="attached")
    await page.wait_for_function(
        """() => new Promise((resolve) => {
        const video = document.getElementById("live"), shown = document.getElementById("picture").dataset;
        const at = shown.frame;
        setTimeout(() => resolve(video.videoWidth === 640 && shown.frame > at), 500); })"""
    )

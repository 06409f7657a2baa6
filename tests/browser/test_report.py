"""The report of a flight, opened from its file in a real Chromium."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio

from control.engagement import State
from gcs.recorder.events import Ordered, Received, Said
from gcs.report.make import write_report
from tests.gcs.replay_rig import record_flight
from tests.gcs.report_rig import START_S, status_text, ticks, write_log

pytestmark = pytest.mark.asyncio(loop_scope="session")

SCREENS = {"laptop": (1366, 768), "phone": (390, 844), "small phone": (320, 568)}
SECTIONS = (
    "Timeline", "From above", "Over time", "What was followed, lost and found", "Limits that clipped",
    "Latency, from light to command", "Link and video", "The operator", "The vehicle's parameters", "Record",
)  # fmt: skip
HOSTILE = "<img src=https://example.org/x onerror=alert(1)><script>alert(2)</script>"


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report(record_flight(tmp_path_factory.mktemp("recorded")))


class Watched:
    """A page, what it asked for and what went wrong in it."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.asked: list[str] = []
        self.wrong: list[str] = []
        page.on("request", lambda request: self.asked.append(request.url))
        page.on("console", lambda message: self.wrong.append(message.text))
        page.on("pageerror", lambda error: self.wrong.append(str(error)))
        page.on("dialog", lambda dialog: self.wrong.append(dialog.message))

    async def open(self, path: Path) -> None:
        await self.page.goto(path.as_uri())
        elsewhere = [url for url in self.asked if not url.startswith("data:") and url != path.as_uri()]
        assert elsewhere == []
        assert self.wrong == []


@pytest_asyncio.fixture(loop_scope="session", params=SCREENS)
async def watched(browser: Any, request: pytest.FixtureRequest) -> AsyncIterator[Watched]:
    width_px, height_px = SCREENS[request.param]
    context = await browser.new_context(viewport={"width": width_px, "height": height_px})
    yield Watched(await context.new_page())
    await context.close()


async def test_the_report_needs_nothing_but_itself_on_any_screen(watched: Watched, report: Path) -> None:
    await watched.open(report)
    page = watched.page
    assert tuple(await page.locator("h2").all_inner_texts()) == SECTIONS
    wide_px, room_px = await page.evaluate("[document.documentElement.scrollWidth, window.innerWidth]")
    assert wide_px <= room_px
    pictures = await page.locator("#moments img").evaluate_all("all => all.map(i => i.complete && i.naturalWidth)")
    assert pictures == [320] * 4
    charts = await page.locator("figure svg").evaluate_all("all => all.map(s => s.getBoundingClientRect().height)")
    assert len(charts) >= 12
    assert min(charts) > 80


async def test_a_click_on_a_moment_leads_to_what_happened(watched: Watched, report: Path) -> None:
    await watched.open(report)
    page = watched.page
    await page.locator(".band a.s-coasting").first.click()
    said = await page.locator(":target").inner_text()
    assert said == "COASTING: the target is not seen"
    await page.locator("tr:has(:target) td a").click()
    assert (await page.locator(":target h3").inner_text()).endswith("found again by itself")
    await page.locator("#curves svg a").nth(1).click()
    assert await page.locator(":target").count() == 1


async def test_hostile_words_of_a_flight_run_nothing(watched: Watched, tmp_path: Path) -> None:
    entries = [
        *ticks(0.0, 1.0, State.FOLLOWING),
        (START_S + 0.2, Said(HOSTILE)),
        (START_S + 0.3, Ordered(HOSTILE, HOSTILE, True)),
        (START_S + 0.4, Received(status_text(HOSTILE[:49]))),
    ]
    await watched.open(write_report(write_log(tmp_path / "flight", entries)))
    assert await watched.page.locator("img, script").count() == 0
    assert HOSTILE in await watched.page.locator("#operator").inner_text()
    assert watched.wrong == []


async def test_it_is_dark_where_that_is_wanted_and_prints_light(watched: Watched, report: Path) -> None:
    page = watched.page

    async def brightness() -> int:
        said: str = await page.evaluate("getComputedStyle(document.body).backgroundColor")
        return int(said.split("(")[1].split(",")[0])

    await page.emulate_media(color_scheme="dark")
    await watched.open(report)
    assert await brightness() < 60
    await page.emulate_media(color_scheme="dark", media="print")
    assert await brightness() == 255

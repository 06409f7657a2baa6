"""A recorded flight in a real browser: played, steered by keys, line and buttons, on a desk and on a phone."""

from __future__ import annotations

import asyncio
import contextlib
import re
import sys
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pytest_asyncio

from gcs.operator.orders import Abort
from gcs.replay.recorded import open_recorded
from gcs.replay.station import ReplayStation
from gcs.replay.timeline import glance
from tests.browser.conftest import LAPTOP, PATIENCE_MS, Desk, playwright_api, reads, shot
from tests.browser.test_overlay import CYAN, GREEN, extent, pixels
from tests.browser.test_screens import CONTRAST, LANDSCAPE, LAYOUT, PORTRAIT
from tests.gcs.replay_rig import RED_BGR, record_flight

pytestmark = pytest.mark.asyncio(loop_scope="session")

SMALL = {"width": 360, "height": 640}
FLIGHT_IS_ORDERED = ("act", "tools", "drawer", "abort", "follow", "closer")


@dataclass
class Shown:
    """`gcs replay` as a process of its own, and browsers in front of it."""

    browser: Any
    url: str
    contexts: list[Any]

    async def open(self, size: dict[str, int] = LAPTOP, **options: Any) -> Any:
        """A page that has the player; at rest at the beginning."""
        context = await self.browser.new_context(viewport=size, **options)
        self.contexts.append(context)
        context.set_default_timeout(PATIENCE_MS)
        page = await context.new_page()
        page.errors = []
        page.on("pageerror", lambda error: page.errors.append(str(error)))
        await page.goto(self.url)
        await page.wait_for_selector("#play[data-playing]")
        await page.wait_for_selector("#notice", state="hidden")
        return page


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_flight(tmp_path_factory.mktemp("flight"))


@pytest_asyncio.fixture(loop_scope="session")
async def shown(browser: Any, flight: Path) -> AsyncIterator[Shown]:
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "gcs.cli", "replay", str(flight), "--port", "0", stdout=asyncio.subprocess.PIPE
    )
    assert process.stdout is not None
    url = (await process.stdout.readline()).decode().removeprefix("page: ").strip()
    opened = Shown(browser, url, [])
    try:
        yield opened
        assert not [error for context in opened.contexts for page in context.pages for error in page.errors]
    finally:
        for context in opened.contexts:
            await context.close()
        with contextlib.suppress(ProcessLookupError):
            process.terminate()
        await process.communicate()


async def at_s(page: Any) -> float:
    """Where it stands."""
    minutes, seconds = (await page.inner_text("#at")).split(":")
    return 60 * int(minutes) + float(seconds)


async def rest(page: Any, *keys: str) -> None:
    """Stand still, then press these, each when the one before has been done."""
    if await page.get_attribute("#play", "data-playing") == "true":
        await page.keyboard.press("Space")
        await page.wait_for_selector("#play[data-playing=false]")
    for key in keys:
        before = await page.get_attribute("#picture", "data-frame")
        await page.keyboard.press(key)
        await page.wait_for_selector(f"#picture:not([data-frame='{before}'])")


async def test_it_plays_stands_still_and_goes_on(shown: Shown) -> None:
    page = await shown.open()
    await reads(page, "watermark", "REPLAY")
    await reads(page, "day", re.compile(r"\d+:\d\d:\d\d"))
    for name in FLIGHT_IS_ORDERED:
        assert not await page.locator(f"#{name}").is_visible()
    await rest(page, "Home")
    await page.keyboard.press("Space")
    await reads(page, "state", "FOLLOWING")
    await rest(page)
    frame, stood_s = await page.get_attribute("#picture", "data-frame"), await at_s(page)
    await page.wait_for_timeout(2000)  # longer than a live picture may be old
    assert await page.get_attribute("#picture", "data-frame") == frame
    assert await at_s(page) == stood_s
    assert not await page.locator("#notice").is_visible()
    await page.click("#play")
    await page.wait_for_selector(f"#picture:not([data-frame='{frame}'])")


async def test_box_and_prediction_are_drawn_where_they_were(shown: Shown) -> None:
    page = await shown.open()
    await rest(page, "Home")
    await page.mouse.click(*await on_line(page, 3.5))
    await reads(page, "state", "FOLLOWING")
    await page.wait_for_selector("#banner[data-tone=good]")
    image = await pixels(page)
    box, target = extent(image, GREEN), extent(image, RED_BGR[::-1])
    assert box is not None
    assert box == pytest.approx(target, abs=6)
    await page.mouse.click(*await on_line(page, 4.9))
    await reads(page, "state", re.compile("COASTING|LOST"))
    image = await drawn(page, (255, 180, 0))  # the tag that says so
    assert extent(image, CYAN) is not None
    assert extent(image, RED_BGR[::-1]) is None
    await shot(page, "replay-lost")


async def drawn(page: Any, colour: tuple[int, int, int]) -> Any:
    """The picture, once there is something of this colour in it: words may stand before it is drawn."""
    async with asyncio.timeout(10.0):
        while extent(image := await pixels(page), colour, near=10) is None:
            await asyncio.sleep(0.05)
    return image


async def on_line(page: Any, t_s: float) -> tuple[float, float]:
    """Where on the screen this time is."""
    edge = await page.locator("#timeline").bounding_box()
    span_s = float(await page.get_attribute("#timeline", "aria-valuemax"))
    return edge["x"] + edge["width"] * t_s / span_s, edge["y"] + edge["height"] / 2


async def test_the_line_shows_states_and_losses(shown: Shown) -> None:
    page = await shown.open()
    await rest(page)
    kinds = await page.eval_on_selector_all("#stretches i", "nodes => nodes.map((node) => node.className)")
    assert kinds[:2] == ["no-video", "idle"]
    assert {"selected", "engaging", "following", "coasting", "released"} <= set(kinds)
    assert await page.locator("#marks .loss").count() == 1
    assert await page.locator("#marks .refused").count() == 1
    await page.mouse.move(*await on_line(page, 4.7))
    await reads(page, "peek", re.compile(r"0:04\.\d COASTING"))
    await page.mouse.down()
    for t_s in np.linspace(4.7, 1.8, 8):
        await page.mouse.move(*await on_line(page, float(t_s)))
    await page.mouse.up()
    await reads(page, "state", "SELECTED")
    assert await at_s(page) == pytest.approx(1.8, abs=0.15)


async def test_pictures_events_and_speeds_have_their_keys(shown: Shown) -> None:
    page = await shown.open()
    await rest(page, "Home", "n", "n")
    there = int((await page.inner_text("#number")).split()[1])
    for key, off in ((".", 1), (".", 2), (",", 1), (",", 0)):
        await rest(page, key)
        await reads(page, "number", f"picture {there + off}")
    await page.keyboard.press("+")
    await playwright_api.expect(page.locator("#rate")).to_have_value("2")
    await page.select_option("#rate", "20")
    await page.keyboard.press("Space")
    await reads(page, "reason", "the recording has ended")
    await page.wait_for_selector("#play[data-playing=false]")
    await page.keyboard.press("p")
    await reads(page, "state", "RELEASED")
    await page.keyboard.press("h")
    await page.locator("#help", has_text="one picture back").wait_for()


async def test_orders_and_refusals_are_told_when_they_were(shown: Shown) -> None:
    page = await shown.open()
    await rest(page, "Home")
    await page.keyboard.press("Space")
    await page.locator("#says", has_text="follow refused: not following: no target").wait_for()
    await page.locator("#says", has_text="confirm to follow").wait_for()
    await rest(page, "Home", "n", "n")
    await page.locator("#says li").first.wait_for(state="detached")  # it was said at another time
    await reads(page, "state", "SELECTED")
    await rest(page, "n")
    await reads(page, "state", "FOLLOWING")
    await reads(page, "lately", re.compile("FOLLOWING"))
    await rest(page, "p", "p")
    await reads(page, "lately", re.compile("follow refused: "))


async def test_who_is_not_in_control_cannot_steer_it(shown: Shown) -> None:
    one = await shown.open()
    await rest(one)
    other = await shown.open()
    await other.keyboard.press("Space")
    await other.locator("#says", has_text="is in control").wait_for()
    assert await other.get_attribute("#play", "data-playing") == "false"


async def test_where_a_flight_follows_a_recording_space_aborts(desk: Desk, flight: Path) -> None:
    """The keys of a player must not outlive it, in a page that was left open."""
    page = await desk.open()
    recorded = open_recorded(flight)
    desk.served.attach(ReplayStation(recorded, glance(recorded)))
    await page.wait_for_selector("#play[data-playing]")
    assert not await page.locator("#abort").is_visible()
    await page.keyboard.press("Space")
    desk.served.attach(desk.station)
    await page.wait_for_selector("#abort", state="visible")
    await page.wait_for_selector("#player", state="detached")
    await reads(page, "vehicle-mode", re.compile(r"\w"))
    await page.keyboard.press("Space")
    await desk.until(lambda: desk.given(Abort))


@pytest.mark.parametrize("size", [LAPTOP, PORTRAIT, LANDSCAPE, SMALL])
async def test_it_fits_desk_and_phone(shown: Shown, size: dict[str, int]) -> None:
    touch = {} if size is LAPTOP else {"has_touch": True, "is_mobile": True}
    page = await shown.open(size, **touch)
    await rest(page, "Home")
    press = page.mouse.click if size is LAPTOP else page.touchscreen.tap
    await press(*await on_line(page, 3.5))
    await reads(page, "state", "FOLLOWING")
    await shot(page, f"replay-{size['width']}x{size['height']}")
    layout = await page.evaluate(LAYOUT)
    assert not layout["scrolls"]
    assert not layout["cut"]
    assert not await page.evaluate(CONTRAST)
    for name in ("timeline", "play", "rate", "at", "picture", "map"):
        edge = await page.locator(f"#{name}").bounding_box()
        assert edge["x"] >= 0
        assert edge["x"] + edge["width"] <= size["width"] + 0.5
        assert edge["y"] + edge["height"] <= size["height"] + 0.5
    if size is not LAPTOP:
        assert (await page.locator("#play").bounding_box())["height"] >= 36
        assert (await page.locator("#map").bounding_box())["height"] >= 40

"""Coming, going, coming back: nothing is armed again by itself, and who is in control is plain."""

from __future__ import annotations

import asyncio
import time
from dataclasses import replace
from typing import Any

import pytest

from control.engagement import State
from gcs.operator.orders import Confirm, Select
from tests.browser.conftest import Cable, Desk, desk_of, drag, playwright_api, reads, select

expect = playwright_api.expect
pytestmark = pytest.mark.asyncio(loop_scope="session")


async def test_the_first_picture_comes_soon(desk: Desk) -> None:
    start_s = time.monotonic()
    page = await desk.open()
    took_ms = (time.monotonic() - start_s) * 1000
    await page.reload()
    start_s = time.monotonic()
    await page.wait_for_selector("#picture[data-frame]:not([data-frame=''])")
    print(f"\nnew browser to first picture {took_ms:.0f} ms, reload {(time.monotonic() - start_s) * 1000:.0f} ms more")


async def test_until_there_is_a_station_it_says_what_is_waited_for(desk: Desk) -> None:
    desk.served.detach()
    desk.served.starting("loading the tracker")
    page = await desk.open(wait=False)
    await reads(page, "notice-text", "loading the tracker")
    assert await page.locator(".spinner").is_visible()
    assert await page.locator("#follow").is_disabled()
    desk.served.attach(desk.station)
    await page.wait_for_selector("#notice", state="hidden")
    await reads(page, "state", "IDLE")


async def test_a_station_that_has_ended_is_not_waited_for(desk: Desk) -> None:
    page = await desk.open()
    await desk.served.close()
    await reads(page, "state", "ENDED")
    await reads(page, "notice-head", "THE STATION HAS ENDED")
    assert await page.locator("#follow").is_disabled()


@pytest.mark.parametrize("watermark", ["SIM", "DRY RUN", "REPLAY", None])
async def test_what_is_not_real_is_framed(browser: Any, watermark: str | None) -> None:
    async with desk_of(browser, watermark=watermark) as desk:
        page = await desk.open()
        assert await page.locator("#frame").is_visible() is (watermark is not None)
        if watermark is not None:
            await reads(page, "watermark", watermark)
            frame, stage = await page.locator("#frame").bounding_box(), await page.locator("#stage").bounding_box()
            assert frame["height"] == pytest.approx(stage["height"], abs=2)
            assert frame["width"] == pytest.approx(frame["height"] * 4 / 3, abs=2)  # round the picture


async def test_every_module_is_asked_for_at_once(desk: Desk) -> None:
    """Else they would come one after the other, as each names the next. Two are asked for only where needed."""
    names = {name for name in desk.served.files if name.endswith(".js")} - {"webrtc.js", "replay.js"}
    index = desk.served.files["index.html"].body.decode()
    assert {name for name in names if f'"/static/{name}"' in index} == names


async def test_ages_count_and_warn(desk: Desk) -> None:
    page = await desk.open()
    for age_s, level in ((0.1, ""), (1.5, "amber"), (4.0, "red")):
        desk.station.age_s = age_s
        await page.wait_for_selector(f"#age-attitude[data-level='{level}']", state="attached")
    await desk.freeze()
    await page.wait_for_selector("#age-video[data-level=amber]")
    await page.wait_for_selector("#age-video[data-level=red]")
    await reads(page, "notice-head", "NO NEW PICTURE")
    assert "grayscale" in await page.locator("#picture").evaluate("node => getComputedStyle(node).filter")


async def test_one_is_in_control_and_another_takes_over_by_force(desk: Desk) -> None:
    first, second = await desk.open(), await desk.open()
    await reads(first, "viewers", "2 viewers")
    await first.click("#take")
    await reads(first, "who", "You are in control")
    await reads(second, "who", "page 1 is in control")
    await drag(second, (300, 250), (360, 310))
    await expect(second.locator("#says li").last).to_have_text("page 1 is in control")
    assert not desk.given(Select)

    await select(desk, first)
    await second.wait_for_selector("#refusals li")
    assert await second.locator("#refusals li").all_text_contents() == ["page 1 is in control"]
    await second.click("#take")
    await reads(second, "take", "Press again to take it")
    await reads(second, "who", "page 1 is in control")
    await second.click("#take")
    await reads(second, "who", "You are in control")
    await reads(first, "who", "page 2 is in control")
    await second.click("#take")
    await reads(first, "who", "Nobody is in control")


async def test_coming_back_arms_nothing(desk: Desk) -> None:
    cable = Cable()
    page = await desk.open(prepare=cable.plug)
    await select(desk, page)
    await page.keyboard.down("f")
    await page.wait_for_selector("#ring:not([hidden])")
    await cable.cut()
    await reads(page, "state", "CONNECTION LOST")
    assert await page.locator("#follow").is_disabled()
    assert "grayscale" in await page.locator("#picture").evaluate("node => getComputedStyle(node).filter")
    first = await page.locator("#notice-text").text_content()
    await expect(page.locator("#notice-text")).not_to_have_text(first)  # its age goes on counting
    cable.is_cut = False
    await page.wait_for_selector("body[data-link=up]")
    await reads(page, "state", "SELECTED")
    await asyncio.sleep(1.2)  # the key is down all the time
    await page.keyboard.up("f")
    assert not desk.given(Confirm)
    assert len(desk.given(Select)) == 1
    assert desk.station.base.state is State.SELECTED


async def test_a_dead_connection_is_noticed_and_made_anew(desk: Desk) -> None:
    cable = Cable()
    page = await desk.open(prepare=cable.plug)
    cable.is_dead = True
    await page.wait_for_selector("body[data-link=lost]")
    cable.is_dead = False
    await page.wait_for_selector("body[data-link=up]")


async def test_a_station_that_was_started_anew_says_so(desk: Desk) -> None:
    cable = Cable()
    page = await desk.open(prepare=cable.plug)
    await page.context.clear_cookies()
    await cable.cut()
    await reads(page, "notice-head", "NO LONGER LET IN")


async def test_a_lost_target_shows(desk: Desk) -> None:
    page = await desk.open()
    await select(desk, page)
    desk.station.visible = False
    desk.station.base = replace(
        desk.station.base, state=State.COASTING, confidence=0.1, warnings=("the target is not seen",)
    )
    await page.wait_for_selector("#banner[data-tone=caution]")
    await reads(page, "warnings", "the target is not seen")
    await page.wait_for_selector("#confidence-bar[data-level=red]", state="attached")
    desk.station.visible = True
    desk.station.base = replace(desk.station.base, state=State.FOLLOWING, confidence=0.9, warnings=())
    await page.wait_for_selector("#banner[data-tone=good]")

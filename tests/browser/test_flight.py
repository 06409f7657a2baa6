"""A flight by the page alone: select, confirm, follow, abort, loss and recovery, with the real station behind it."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path
from typing import Any

import pytest

from tests.browser.conftest import LAPTOP, reads, shot
from tests.browser.flight import draw_target, flown, hold_follow

pytestmark = [pytest.mark.asyncio(loop_scope="session"), pytest.mark.timeout(180)]


async def _opened(browser: Any, url: str) -> Any:
    context = await browser.new_context(viewport=LAPTOP)
    context.set_default_timeout(20_000)
    page = await context.new_page()
    await page.goto(url)
    await page.locator("#state", has_text="IDLE").wait_for(timeout=60_000)  # the station is starting
    return page


async def test_select_confirm_follow_abort_and_again(browser: Any, tmp_path: Path) -> None:
    async with flown(tmp_path) as flight:
        page = await _opened(browser, flight.url)
        await shot(page, "flight-idle")
        await draw_target(flight, page)
        assert flight.monitor["moving_setpoints"] == 0
        flight.simulator._monitor.operator_confirms(time.monotonic())
        await hold_follow(page)
        await asyncio.sleep(6.0)
        await shot(page, "flight-following")
        assert flight.monitor["moving_setpoints"] > 20
        pressed_s = time.monotonic()
        await page.keyboard.press("Space")
        await reads(page, "state", "RELEASED")
        await shot(page, "flight-aborted")
        assert flight.monitor["last_moving_setpoint_t_s"] < pressed_s + 0.5
        moving = flight.monitor["moving_setpoints"]
        await page.reload()
        await reads(page, "state", "RELEASED")
        await asyncio.sleep(1.0)
        assert flight.monitor["moving_setpoints"] == moving  # coming back arms nothing
        await page.click("#ack")
        await draw_target(flight, page)
        flight.simulator._monitor.operator_confirms(time.monotonic())
        await hold_follow(page)
        assert flight.monitor["unsafe"] == 0, flight.monitor["reasons"]
        await page.context.close()


async def test_what_goes_behind_a_bridge_is_coasted_for_and_followed_again(browser: Any, tmp_path: Path) -> None:
    async with flown(tmp_path, scene="occlusion") as flight:
        page = await _opened(browser, flight.url)
        await draw_target(flight, page)
        flight.simulator._monitor.operator_confirms(time.monotonic())
        await hold_follow(page)
        await page.locator("#state", has_text="COASTING").wait_for(timeout=60_000)
        await shot(page, "flight-coasting")
        await reads(page, "state", "FOLLOWING")
        assert flight.monitor["unsafe"] == 0, flight.monitor["reasons"]
        await page.context.close()

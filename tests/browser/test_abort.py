"""Abort: at once, from anywhere, whatever is broken."""

from __future__ import annotations

import time
from typing import Any

import pytest

from gcs.operator.orders import Abort, Confirm, Select
from tests.browser.conftest import Cable, Desk, reads, select

pytestmark = pytest.mark.asyncio(loop_scope="session")


async def test_keys_abort_from_any_focus_and_do_nothing_else(desk: Desk) -> None:
    page = await desk.open()
    await select(desk, page)
    focuses = ("#accept-name", "#takeoff-height", "button[data-do=land]", "#take", "#follow", "#help .close")
    pressed = [(key, focus) for key in ("Space", "Escape") for focus in focuses]
    for count, (key, focus) in enumerate(pressed, start=1):
        await page.keyboard.press("h" if "help" in focus else "d")
        await page.locator(focus).focus()
        await page.keyboard.press(key)
        await desk.until(lambda count=count: len(desk.given(Abort)) == count)
        await page.wait_for_selector("#abort[data-phase=done]")
        assert await page.locator("#drawer, #help").evaluate_all("nodes => nodes.every((node) => node.hidden)")
    assert [type(order) for order in desk.station.orders] == [Select] + [Abort] * len(pressed)
    assert await page.input_value("#accept-name") == ""
    await reads(page, "who", "You are in control")  # the button that had the focus was not pressed


async def test_the_button_aborts_when_pressed_not_when_let_go(desk: Desk) -> None:
    page = await desk.open()
    await page.hover("#abort")
    await page.mouse.down()
    await desk.until(lambda: desk.given(Abort))
    await reads(page, "abort-hint", "abort: zero, then hold")
    await page.mouse.up()
    assert len(desk.given(Abort)) == 1


@pytest.mark.parametrize("broken", ["cut", "dead"])
async def test_without_a_websocket_it_goes_by_post(desk: Desk, broken: str) -> None:
    cable = Cable()
    page = await desk.open(prepare=cable.plug)
    if broken == "cut":
        await cable.cut()
        await page.wait_for_selector("body[data-link=lost]")
    else:
        cable.is_dead = True
    await page.keyboard.press("Space")
    await desk.until(lambda: desk.given(Abort))
    await reads(page, "abort-hint", "abort: zero, then hold")


async def test_it_is_tried_until_it_is_answered(desk: Desk) -> None:
    cable, failed = Cable(), []

    async def prepare(page: Any) -> None:
        await cable.plug(page)
        await page.route("**/abort", refuse)

    async def refuse(route: Any) -> None:
        failed.append(route)
        if len(failed) <= 2:
            await route.abort()
        else:
            await route.continue_()

    page = await desk.open(prepare=prepare)
    await cable.cut()
    await page.wait_for_selector("body[data-link=lost]")
    await page.keyboard.press("Escape")
    await reads(page, "abort-hint", "NO ANSWER, try 2 …")
    await desk.until(lambda: desk.given(Abort))
    await reads(page, "abort-hint", "abort: zero, then hold")
    assert len(failed) == 3


async def test_who_is_not_in_control_aborts_too(desk: Desk) -> None:
    flying, looking = await desk.open(), await desk.open()
    await select(desk, flying)
    await flying.keyboard.down("f")
    await desk.until(lambda: desk.given(Confirm))
    await flying.keyboard.up("f")
    await reads(looking, "state", "FOLLOWING")
    await looking.keyboard.press("Space")
    await desk.until(lambda: desk.given(Abort))
    await reads(flying, "state", "RELEASED")


async def test_how_long_it_takes_from_the_key_to_the_station(desk: Desk) -> None:
    page = await desk.open()
    took_ms = []
    for count in range(1, 31):
        start_s = time.monotonic()
        await page.keyboard.press("Space")
        await desk.until(lambda count=count: len(desk.given(Abort)) == count)
        took_ms.append((time.monotonic() - start_s) * 1000)
        await page.wait_for_selector("#abort[data-phase=done]")
    took_ms.sort()
    print(f"\nkey to the station's order: median {took_ms[15]:.0f} ms, worst of 30 {took_ms[-1]:.0f} ms")

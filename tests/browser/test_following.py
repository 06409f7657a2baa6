"""Confirming is meant: held for a second, by key or button, and void as soon as anything comes between."""

from __future__ import annotations

import asyncio
import time
from dataclasses import replace
from typing import Any

import pytest

from control.engagement import State
from control.modes import FollowMode
from gcs.operator.orders import (
    Acknowledge,
    Confirm,
    Land,
    Record,
    SetDistance,
    SetMode,
    SetStandoff,
    StepStandoff,
    TakeOff,
)
from tests.browser.conftest import Cable, Desk, reads, select

pytestmark = pytest.mark.asyncio(loop_scope="session")


async def is_void(desk: Desk, page: Any) -> None:
    """The ring is gone, and a second later nothing has been confirmed."""
    await page.wait_for_selector("#ring", state="hidden")
    await asyncio.sleep(1.2)
    assert not desk.given(Confirm)


async def test_the_key_confirms_after_a_second_and_not_before(desk: Desk) -> None:
    page = await desk.open()
    await select(desk, page)
    await page.keyboard.down("f")
    await page.wait_for_selector("#ring:not([hidden])")
    await asyncio.sleep(0.5)
    await page.keyboard.up("f")
    await is_void(desk, page)

    pressed_s = time.monotonic()
    await page.keyboard.down("f")
    await desk.until(lambda: desk.given(Confirm))
    assert time.monotonic() - pressed_s >= 0.95
    await reads(page, "state", "FOLLOWING")
    await asyncio.sleep(1.2)  # the key is still down: it has confirmed once
    await page.keyboard.up("f")
    assert len(desk.given(Confirm)) == 1


async def test_the_button_confirms_when_held_and_not_when_left(desk: Desk) -> None:
    page = await desk.open()
    await select(desk, page)
    await page.click("#follow")
    await page.hover("#follow")
    await page.mouse.down()
    await page.wait_for_selector("#ring:not([hidden])")
    await page.mouse.move(600, 300)
    await is_void(desk, page)
    await page.mouse.up()

    await page.hover("#follow")
    await page.mouse.down()
    await desk.until(lambda: desk.given(Confirm))
    await page.mouse.up()
    await reads(page, "state", "FOLLOWING")


@pytest.mark.parametrize("what", ["another target", "a refusal", "the window was left", "the connection", "abort"])
async def test_a_hold_is_void_when_something_comes_between(desk: Desk, what: str) -> None:
    cable = Cable()
    page = await desk.open(prepare=cable.plug)
    await select(desk, page)
    await page.keyboard.down("f")
    await page.wait_for_selector("#ring:not([hidden])")
    match what:
        case "another target":
            desk.station.base = replace(desk.station.base, selection=desk.station.base.selection + 1)
        case "a refusal":
            desk.station.refused = ("the battery is too low",)
        case "the window was left":
            await page.evaluate("dispatchEvent(new Event('blur'))")
        case "the connection":
            await cable.cut()
        case _:
            await page.keyboard.press("Escape")
    await is_void(desk, page)


async def test_what_is_refused_cannot_be_pressed_and_says_why(desk: Desk) -> None:
    desk.station.refused = ("the vehicle is not armed", "the battery is too low")
    page = await desk.open()
    edge = await page.locator("#picture").bounding_box()
    await page.mouse.click(edge["x"] + edge["width"] / 2, edge["y"] + edge["height"] / 2)
    await page.wait_for_selector("#refusals li")
    assert await page.locator("#refusals li").all_text_contents() == list(desk.station.refused)
    await page.keyboard.down("f")
    await page.wait_for_selector("#refusals.flash")
    await is_void(desk, page)
    await page.keyboard.up("f")


async def test_what_has_ended_is_acknowledged(desk: Desk) -> None:
    page = await desk.open()
    await select(desk, page)
    desk.station.base = replace(desk.station.base, state=State.RELEASED)
    await page.wait_for_selector("#ack:not([hidden])")
    assert await page.locator("#follow").is_hidden()
    await page.keyboard.press("Enter")
    await desk.until(lambda: desk.given(Acknowledge))
    await page.wait_for_selector("#follow:not([hidden])")


async def test_modes_standoff_and_recording_by_key(desk: Desk) -> None:
    page = await desk.open()
    await page.keyboard.press("m")
    await desk.until(lambda: desk.given(SetMode) == [SetMode(FollowMode.PARALLEL)])
    await reads(page, "mode", "parallel")
    await page.keyboard.press("r")
    await desk.until(lambda: desk.given(Record))
    await page.wait_for_selector("#recording", state="hidden")

    desk.station.base = replace(desk.station.base, distance_m=15.4)
    await reads(page, "distance", "15.4 m")
    await page.keyboard.press("]")
    await desk.until(lambda: desk.given(SetStandoff) == [SetStandoff(17.0)])
    desk.station.base = replace(desk.station.base, state=State.FOLLOWING, standoff_m=17.0)
    await reads(page, "state", "FOLLOWING")
    await page.keyboard.press("[")
    await desk.until(lambda: desk.given(StepStandoff) == [StepStandoff(-2.0)])


async def test_the_drawer_needs_a_second_too(desk: Desk) -> None:
    page = await desk.open()
    await page.keyboard.press("d")
    await page.click("button[data-do=land]")
    await page.fill("#takeoff-height", "12")
    await page.hover("button[data-do=takeoff]")
    await page.mouse.down()
    await desk.until(lambda: desk.given(TakeOff))
    await page.mouse.up()
    assert desk.given(TakeOff) == [TakeOff(12.0)]
    assert not desk.given(Land)
    await page.wait_for_selector("#drawer", state="hidden")  # the picture is what counts now
    await page.keyboard.press("d")
    await page.fill("#distance-value", "21.5")
    await page.press("#distance-value", "Enter")
    await desk.until(lambda: desk.given(SetDistance) == [SetDistance(21.5)])

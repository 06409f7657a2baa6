"""How the page looks: what must be there in every state and size. With SHOTS=folder the pictures are kept."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Any

import pytest

from control.engagement import State
from tests.browser.conftest import LAPTOP, Cable, Desk, drag, reads, shot

pytestmark = pytest.mark.asyncio(loop_scope="session")

PORTRAIT, LANDSCAPE = {"width": 390, "height": 844}, {"width": 844, "height": 390}
SIZES = {"laptop": LAPTOP, "portrait": PORTRAIT, "landscape": LANDSCAPE}
REFUSED = (
    "the vehicle is not armed", "the vehicle is not in the air", "the battery is too low",
    "the distance to the target is unknown: type it", "the vehicle's parameters are not safe for following",
    "the picture reaches the controls too late",
)  # fmt: skip

LAYOUT = """() => {
  const shown = (node) => node.checkVisibility({visibilityProperty: true});
  const edge = (node) => { const e = node.getBoundingClientRect(); return [e.left, e.top, e.right, e.bottom]; };
  const isCut = (node) => {
    const [left, top, right, bottom] = edge(node);
    const isOutside = left < -.5 || top < -.5 || right > innerWidth + .5 || bottom > innerHeight + .5;
    return isOutside || node.scrollWidth > node.clientWidth + 1;
  };
  const texts = 'button, #refusals li, #ages dd, .figure b, #flight li, #drawer input, #help dd';
  const scroller = document.scrollingElement;
  return {
    cut: [...document.querySelectorAll(texts)].filter(shown).filter(isCut).map((node) => node.id || node.textContent),
    decides: [...document.querySelectorAll('#act button')].filter(shown).map(edge),
    abort: edge(document.getElementById('abort')),
    scrolls: scroller.scrollHeight > innerHeight || scroller.scrollWidth > innerWidth,
  };
}"""
# What lies on top at ABORT's middle and corners: nothing may cover it.
UNCOVERED = """() => {
  const node = document.getElementById('abort'), e = node.getBoundingClientRect();
  return [[.5, .5], [.1, .2], [.9, .2], [.1, .8], [.9, .8]].every(([x, y]) =>
    node.contains(document.elementFromPoint(e.left + e.width * x, e.top + e.height * y)));
}"""
CONTRAST = """() => {
  const linear = (v) => v <= .04045 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4;
  const light = ([r, g, b]) => [r, g, b].map((v) => linear(v / 255))
    .reduce((sum, v, at) => sum + v * [.2126, .7152, .0722][at], 0);
  const numbers = (colour) => colour.match(/[\\d.]+/g).map(Number);
  const ground = (node) => {
    for (let at = node; at; at = at.parentElement) {
      const [r, g, b, a = 1] = numbers(getComputedStyle(at).backgroundColor);
      if (a > .8) return [r, g, b];
    }
    return [0, 0, 0];
  };
  const faint = [];
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const node = walk.currentNode.parentElement;
    const isShown = node.checkVisibility({visibilityProperty: true, opacityProperty: true});
    if (!walk.currentNode.textContent.trim() || !isShown) continue;
    const [a, b] = [light(numbers(getComputedStyle(node).color)), light(ground(node))];
    const ratio = (Math.max(a, b) + .05) / (Math.min(a, b) + .05);
    if (ratio < 7) faint.push(`${node.id || node.textContent.trim()} ${ratio.toFixed(1)}`);
  }
  return faint;
}"""


async def check(page: Any, name: str) -> None:
    """Nothing scrolls, nothing is cut off, ABORT is whole and on top, every text can be read in the sun."""
    await shot(page, name)
    layout = await page.evaluate(LAYOUT)
    width, height = page.viewport_size["width"], page.viewport_size["height"]
    assert not layout["scrolls"]
    assert not layout["cut"]
    left, top, right, bottom = layout["abort"]
    assert left >= 0
    assert top >= 0
    assert right <= width
    assert bottom <= height
    assert (right - left) >= 130
    assert (bottom - top) >= 80
    assert await page.evaluate(UNCOVERED)
    others = [each for each in layout["decides"] if each != layout["abort"]]
    for a in others:
        assert a[2] <= left or a[0] >= right or a[3] <= top or a[1] >= bottom, "ABORT and FOLLOW overlap"
    assert not await page.evaluate(CONTRAST)


def follow(desk: Desk) -> None:
    """As after a confirmation, with something in every field."""
    desk.station.base = replace(
        desk.station.base, state=State.FOLLOWING, distance_m=15.4, standoff_m=15.0,
        limited_by=("yaw rate", "fence"), warnings=("much of the telemetry is lost on the way",),
    )  # fmt: skip


@pytest.mark.parametrize("size", SIZES)
async def test_every_state_fits(desk: Desk, size: str) -> None:
    touch = {} if size == "laptop" else {"has_touch": True, "is_mobile": True}
    cable = Cable()
    page = await desk.open(SIZES[size], prepare=cable.plug, **touch)
    await check(page, f"{size}-idle")

    desk.station.refused = REFUSED
    await drag(page, (300, 250), (360, 310))
    await page.wait_for_selector("#refusals li")
    assert await page.locator("#refusals li").all_text_contents() == list(REFUSED)
    assert await page.locator("#follow").is_disabled()
    await check(page, f"{size}-refused")

    desk.station.refused = ()
    await page.wait_for_selector("#follow:not(:disabled)")
    await check(page, f"{size}-selected")

    follow(desk)
    await reads(page, "state", "FOLLOWING")
    assert await page.locator("#limits li").all_text_contents() == ["yaw rate", "fence"]
    await page.keyboard.press("c")
    await asyncio.sleep(0.4)
    await check(page, f"{size}-following")
    await page.keyboard.press("c")

    desk.station.visible = False
    desk.station.base = replace(desk.station.base, state=State.LOST_HOLD, confidence=0.12, warnings=())
    await page.wait_for_selector("#banner[data-tone=caution]")
    await asyncio.sleep(0.2)
    await check(page, f"{size}-lost")

    desk.station.base = replace(desk.station.base, state=State.RELEASED)
    await page.wait_for_selector("#ack:not([hidden])")
    await check(page, f"{size}-released")

    await page.locator("#orders").click()
    await check(page, f"{size}-drawer")
    await page.keyboard.press("h")
    await check(page, f"{size}-help")
    await page.locator("#help .close").click()

    await cable.cut()
    await page.wait_for_selector("body[data-link=lost]")
    await reads(page, "state", "CONNECTION LOST")
    await check(page, f"{size}-disconnected")
    assert "grayscale" in await page.locator("#picture").evaluate("node => getComputedStyle(node).filter")


WINDOWS = ((1920, 1080), (1024, 600), (800, 600), (768, 1024), (375, 667), (667, 375))


async def test_other_windows_fit_too(desk: Desk) -> None:
    page = await desk.open()
    await drag(page, (300, 250), (360, 310))
    await reads(page, "state", "SELECTED")
    for state, refused in ((State.FOLLOWING, ()), (State.SELECTED, REFUSED)):
        follow(desk)
        desk.station.refused = refused
        desk.station.base = replace(desk.station.base, state=state)
        await reads(page, "state", state.value.upper())
        await page.wait_for_selector("#refusals", state="visible" if refused else "hidden")
        for width, height in WINDOWS:
            await page.set_viewport_size({"width": width, "height": height})
            await check(page, f"{width}x{height}-{state.value}")

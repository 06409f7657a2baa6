"""What is pointed at reaches the station: the right pixels, of the picture that was shown."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gcs.operator.orders import Deselect, Select, SelectCandidate, SelectPoint
from tests.browser.conftest import LAPTOP, Desk, desk_of, drag, place_of, reads, select
from tests.browser.test_screens import PORTRAIT

pytestmark = pytest.mark.asyncio(loop_scope="session")

WINDOWS = [
    (LAPTOP, (640, 480), 1.0),  # bars left and right
    ({"width": 900, "height": 620}, (1280, 720), 1.0),  # bars above and below
    (PORTRAIT, (640, 480), 3.0),  # a phone's dense screen
    ({"width": 2100, "height": 700}, (320, 240), 1.5),  # enlarged
]


@pytest.mark.parametrize(("window", "size", "density"), WINDOWS)
async def test_a_box_means_these_pixels(
    browser: Any, window: dict[str, int], size: tuple[int, int], density: float
) -> None:
    async with desk_of(browser, size) as desk:
        page = await desk.open(window, device_scale_factor=density)
        start, end = (size[0] * 0.4, size[1] * 0.3), (size[0] * 0.55, size[1] * 0.6)
        await drag(page, end, start, size)  # from any corner
        await desk.until(lambda: desk.given(Select))
        (order,) = desk.given(Select)
        wanted = (*start, end[0] - start[0], end[1] - start[1])
        assert order.box.xywh == pytest.approx(wanted, abs=1.5 * size[0] / window["width"] + 0.2)


async def test_a_point_means_the_picture_it_was_pressed_on_and_a_box_the_one_it_was_let_go_on(desk: Desk) -> None:
    page = await desk.open()
    await desk.freeze()
    shown = await desk.show(page)
    edge = await page.locator("#picture").bounding_box()
    await page.mouse.move(*place_of(edge, desk.station.size, 200, 150))
    await page.mouse.down()
    await desk.show(page)
    await page.mouse.up()
    await desk.until(lambda: desk.given(SelectPoint))
    (point,) = desk.given(SelectPoint)
    assert (point.x_px, point.y_px) == pytest.approx((200, 150), abs=1)
    assert point.frame.seq == shown

    await page.mouse.move(*place_of(edge, desk.station.size, 100, 100))
    await page.mouse.down()
    await page.mouse.move(*place_of(edge, desk.station.size, 180, 170))
    shown = await desk.show(page)
    await page.mouse.up()
    await desk.until(lambda: desk.given(Select))
    assert desk.given(Select)[0].frame.seq == shown


async def test_a_finger_draws_too_and_a_second_one_cancels(desk: Desk) -> None:
    page = await desk.open(PORTRAIT, has_touch=True, is_mobile=True)
    touch = await page.context.new_cdp_session(page)
    edge = await page.locator("#picture").bounding_box()

    async def fingers(kind: str, *points: tuple[float, float]) -> None:
        at = [dict(zip("xy", place_of(edge, desk.station.size, *point), strict=True)) for point in points]
        ends = [{**point, "id": id} for id, point in enumerate(at)]
        await touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": ends})

    await fingers("touchStart", (100, 100))
    await fingers("touchMove", (140, 140))
    await fingers("touchStart", (140, 140), (300, 300))
    await fingers("touchEnd")
    await fingers("touchStart", (300, 200))
    await fingers("touchMove", (350, 240))
    await fingers("touchMove", (400, 300))
    await fingers("touchEnd")
    await desk.until(lambda: desk.given(Select))
    (order,) = desk.given(Select)
    assert order.box.xywh == pytest.approx((300, 200, 100, 100), abs=3)
    await page.touchscreen.tap(*place_of(edge, desk.station.size, 320, 400))
    await desk.until(lambda: desk.given(SelectPoint))
    assert await page.evaluate("[scrollX, scrollY, visualViewport.scale]") == [0, 0, 1]


async def test_what_is_too_small_or_beside_the_picture_selects_nothing(desk: Desk) -> None:
    page = await desk.open()
    await drag(page, (100, 100), (300, 104))
    await reads(page, "says", "the box is too small: 10 pixels of the picture at least")
    await page.mouse.click(230 - 26, 130)  # left of the picture
    await page.mouse.click(1366 / 2, 400, button="right")
    await drag(page, (600, 440), (900, 600))  # over the edge: clipped
    await desk.until(lambda: desk.given(Select))
    assert desk.given(Select)[0].box.xywh == pytest.approx((600, 440, 40, 40), abs=1)
    assert not desk.given(SelectPoint)


async def test_numbered_boxes_are_picked_by_key_by_click_and_by_track(desk: Desk) -> None:
    page = await desk.open()
    await page.keyboard.press("t")  # nothing is tracked: the candidate nearest the centre
    await desk.until(lambda: desk.given(SelectCandidate))
    assert desk.given(SelectCandidate)[0].number == 1
    await reads(page, "state", "SELECTED")

    await page.wait_for_selector("#follow:not(:disabled)")
    await asyncio.sleep(0.2)  # its box is on the screen
    await page.keyboard.press("t")  # it is: its box again
    await desk.until(lambda: desk.given(Select))

    await page.keyboard.press("c")
    await page.wait_for_selector("#boxes[aria-pressed=true]")
    await asyncio.sleep(0.5)  # they are told four times a second
    await page.keyboard.press("2")
    await desk.until(lambda: len(desk.given(SelectCandidate)) == 2)
    edge = await page.locator("#picture").bounding_box()
    await page.mouse.click(*place_of(edge, desk.station.size, 101, 101))  # within number 2
    await desk.until(lambda: len(desk.given(SelectCandidate)) == 3)
    assert [order.number for order in desk.given(SelectCandidate)] == [1, 2, 2]

    await page.keyboard.press("x")
    await desk.until(lambda: desk.given(Deselect))


async def test_keys_nudge_and_resize_gathering_what_comes_fast(desk: Desk) -> None:
    page = await desk.open()
    await select(desk, page)
    await desk.freeze()
    await desk.show(page)
    target = desk.station.show().seen.result
    assert target is not None
    last = desk.station.frames.newest
    assert last is not None
    await page.wait_for_selector(f"#picture[data-frame='{last.seq}']")
    for _ in range(12):
        await page.keyboard.press("ArrowRight")
    for _ in range(3):
        await page.keyboard.press("Shift+ArrowUp")
    await desk.until(lambda: len(desk.given(Select)) > 1)
    await asyncio.sleep(1)
    nudged = desk.given(Select)[1:]
    assert len(nudged) <= 3
    assert all(order.frame.seq == last.seq for order in nudged)
    moved = [(order.box.cx_px - target.box.cx_px, order.box.cy_px - target.box.cy_px) for order in nudged]
    assert sum(x for x, _ in moved) == pytest.approx(24, abs=1)
    assert sum(y for _, y in moved) == pytest.approx(-36, abs=1)
    before = len(desk.given(Select))
    await page.keyboard.press("+")
    await desk.until(lambda: len(desk.given(Select)) > before)
    assert desk.given(Select)[-1].box.w_px == pytest.approx(target.box.w_px * 1.06, rel=0.01)

"""What is drawn on the picture, read from the canvas's own pixels."""

from __future__ import annotations

import base64
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from control.engagement import State
from tests.browser.conftest import Desk, desk_of, select

pytestmark = pytest.mark.asyncio(loop_scope="session")

# The canvas is drawn at once: whatever moment is asked for, picture and boxes are of one frame.
READ = """node => {
  const {width, height} = node, data = node.getContext('2d').getImageData(0, 0, width, height).data;
  let text = '';
  for (let at = 0; at < data.length; at += 32768) text += String.fromCharCode(...data.subarray(at, at + 32768));
  return [width, height, btoa(text)];
}"""
CYAN, GREEN, RED = (60, 230, 255), (61, 255, 122), (200, 40, 40)


async def pixels(page: Any) -> npt.NDArray[np.uint8]:
    """(H, W, 3)."""
    width, height, data = await page.locator("#picture").evaluate(READ)
    return np.frombuffer(base64.b64decode(data), np.uint8).reshape(height, width, 4)[:, :, :3]


def extent(
    image: npt.NDArray[np.uint8], colour: tuple[int, int, int], near: int = 40
) -> tuple[int, int, int, int] | None:
    """(left, top, right, bottom) of everything of this colour."""
    ys, xs = np.nonzero(np.all(np.abs(image.astype(int) - colour) < near, axis=2))
    return (int(xs.min()), int(ys.min()), int(xs.max()), int(ys.max())) if len(xs) else None


@pytest.mark.parametrize("size", [(640, 480), (1280, 720)])
async def test_the_box_never_lags_its_picture(browser: Any, size: tuple[int, int]) -> None:
    """The scripted target is a red rectangle exactly where its box is, and moves with every frame."""
    async with desk_of(browser, size) as desk:
        page = await desk.open({"width": 800, "height": 600})
        await select(desk, page)
        desk.station.base = replace(desk.station.base, state=State.FOLLOWING)
        await page.wait_for_selector("#banner[data-tone=good]")
        lefts = set()
        for _ in range(8):
            image = await pixels(page)
            box, target = extent(image, GREEN), extent(image, RED)
            assert box is not None
            assert target is not None
            lefts.add(target[0])
            assert box == pytest.approx(target, abs=4)
        assert len(lefts) > 1


async def test_the_prediction_is_corners_only_and_alone_when_the_target_is_not_seen(desk: Desk) -> None:
    page = await desk.open()
    await select(desk, page)
    await desk.freeze()
    desk.station.visible = False
    await desk.show(page)
    image = await pixels(page)
    corners = extent(image, CYAN)
    assert corners is not None
    left, top, right, bottom = corners
    middle = image[(top + bottom) // 2, left - 3 : left + 6]
    assert not np.any(np.all(np.abs(middle.astype(int) - CYAN) < 40, axis=1))  # no line along the side
    assert extent(image[top:bottom, left:right], (255, 255, 255), near=10) is None  # no tracker's box
    assert extent(image, (255, 180, 0), near=10) is not None  # the tag that says so

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs.hud import AMBER, CYAN, GREEN, RED, Overlay, Tone, draw
from tracker.box import Box

GREY = 128


def picture(height: int = 360, width: int = 640) -> np.ndarray:
    return np.full((height, width, 3), GREY, np.uint8)


def has_colour(image: np.ndarray, colour: tuple[int, int, int]) -> bool:
    return bool((image == np.array(colour, np.uint8)).all(axis=2).any())


def test_the_given_picture_stays_untouched() -> None:
    image = picture()
    drawn = draw(image, Overlay("IDLE"))
    assert (image == GREY).all()
    assert drawn.shape == image.shape
    assert not np.array_equal(drawn, image)


@pytest.mark.parametrize(("tone", "colour"), [(Tone.GOOD, GREEN), (Tone.CAUTION, AMBER), (Tone.ALARM, RED)])
def test_the_box_has_the_colour_of_the_state_and_stands_where_it_should(
    tone: Tone, colour: tuple[int, int, int]
) -> None:
    drawn = draw(picture(), Overlay("X", tone, box=Box(300, 200, 80, 40)))
    assert drawn[180, 300].tolist() == list(colour)
    assert drawn[200, 260].tolist() == list(colour)
    assert (drawn[190:210, 280:320] == GREY).all()  # the target itself stays visible


def test_prediction_watermark_and_figures_show() -> None:
    plain = draw(picture(), Overlay("X"))
    assert has_colour(draw(picture(), Overlay("X", predicted=Box(300, 200, 80, 40))), CYAN)
    marked = draw(picture(), Overlay("X", watermark="DRY RUN"))
    assert has_colour(marked, AMBER)
    assert not has_colour(plain, AMBER)
    figures = draw(picture(), Overlay("X", lines=("a", "b")))
    assert figures[-5, -5, 0] < GREY == plain[-5, -5, 0]


@pytest.mark.parametrize(
    "box", [Box(-5000, 9e9, 1e12, 20), Box(math.nan, 1, 2, 3), Box(10, 10, 0, 0), Box(0, 0, 1, 1), Box(1e308, 0, 9, 9)]
)
@pytest.mark.parametrize("size", [(16, 16), (240, 320), (2160, 4096)])
def test_no_box_and_no_size_of_picture_can_upset_it(box: Box, size: tuple[int, int]) -> None:
    overlay = Overlay(
        "LOST HOLD", Tone.ALARM, box, box, 0.5, 1e9, -1e9, 12.0, "DRY RUN", tuple(str(i) for i in range(30))
    )
    assert draw(picture(*size), overlay).shape == (*size, 3)

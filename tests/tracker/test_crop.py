from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tracker.box import Box
from tracker.crop import Colour, Image, check_box, check_frame, context_side_px, crop, mean_colour


def padded_crop(frame: Image, cx: float, cy: float, side: int, out: int, fill: Colour) -> Image:
    """The plain way: a padded copy of the whole frame, then a slice."""
    height, width = frame.shape[:2]
    half = (side + 1) / 2
    x0, y0 = math.floor(cx - half + 0.5), math.floor(cy - half + 0.5)
    pad = max(0, -x0, -y0, x0 + side - width, y0 + side - height)
    padded = np.empty((height + 2 * pad, width + 2 * pad, 3), np.uint8)
    padded[:] = fill
    padded[pad : pad + height, pad : pad + width] = frame
    window = padded[y0 + pad : y0 + pad + side, x0 + pad : x0 + pad + side]
    return window if side == out else cv2.resize(window, (out, out))


@settings(max_examples=150, deadline=None)
@given(
    shape=st.tuples(st.integers(1, 60), st.integers(1, 60)),
    centre=st.tuples(st.floats(-80, 140), st.floats(-80, 140)),
    side=st.integers(1, 150),
    out=st.sampled_from([17, 32]),
)
def test_same_pixels_as_padding_everything(
    shape: tuple[int, int], centre: tuple[float, float], side: int, out: int
) -> None:
    frame = np.random.default_rng(0).integers(0, 256, (*shape, 3), dtype=np.uint8)
    fill = (1, 200, 77)
    found = crop(frame, *centre, side, out, fill)
    assert found.shape == (out, out, 3)
    assert found.dtype == np.uint8
    np.testing.assert_array_equal(found, padded_crop(frame, *centre, side, out, fill))


def test_crop_never_copies_or_changes_the_frame() -> None:
    frame = np.full((40, 40, 3), 9, np.uint8)
    frame.flags.writeable = False
    assert crop(frame, 0, 0, 30, 15, (5, 5, 5)).min() == 5
    with pytest.raises(ValueError, match="crop side 0 px"):
        crop(frame, 0, 0, 0, 15, (5, 5, 5))


def test_mean_colour_is_truncated() -> None:
    frame = np.zeros((2, 2, 3), np.uint8)
    frame[0, 0] = (3, 7, 8)
    assert mean_colour(frame) == (0, 1, 2)


def test_context_side() -> None:
    assert round(context_side_px(48, 36, 0.5)) == 84  # the reference run's


@pytest.mark.parametrize(
    ("box", "words"),
    [
        (Box(50, 50, 0, 10), "too small"),
        (Box(50, 50, 3, 10), "at least 4 px"),
        (Box(50, 50, -5, 10), "w=-5.0"),
        (Box(math.nan, 50, 10, 10), "finite"),
        (Box(50, math.inf, 10, 10), "finite"),
        (Box(-20, 50, 10, 10), "outside the 100x80 frame"),
        (Box(102, 50, 10, 10), "outside the 100x80 frame"),
        (Box(50, 83, 10, 10), "outside the 100x80 frame"),
        (Box(50, 40, 101, 10), "larger than the 100x80 frame"),
    ],
)
def test_unusable_boxes(box: Box, words: str) -> None:
    with pytest.raises(ValueError, match="box x=") as caught:
        check_box(box, np.zeros((80, 100, 3), np.uint8), 4)
    assert words in str(caught.value)


def test_box_partly_outside_is_usable() -> None:
    check_box(Box(0, 0, 20, 20), np.zeros((80, 100, 3), np.uint8), 4)


@pytest.mark.parametrize(
    "frame",
    [
        None,
        [[1]],
        np.zeros((4, 4), np.uint8),
        np.zeros((4, 4, 4), np.uint8),
        np.zeros((4, 4, 3), np.float32),
        np.zeros((0, 4, 3), np.uint8),
    ],
    ids=["none", "list", "grey", "alpha", "float", "empty"],
)
def test_unusable_frames(frame: object) -> None:
    with pytest.raises(ValueError, match=r"^frame (is|has shape) .*\(H, W, 3\) of uint8"):
        check_frame(frame)

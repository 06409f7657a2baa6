from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from tracker.box import Box
from tracker.configs import TrackerConfig
from tracker.decode import decode

CONFIG = TrackerConfig()
OLD = Box(320, 240, 40, 30)
FRAME = (640, 480)
Maps = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def steady_maps() -> Maps:
    """Maps that find the old box again, in the middle cell, at scale 1."""
    loc = np.empty((4, 11, 11))
    loc[:2], loc[2:] = math.tanh(20 / 143), math.tanh(15 / 143)
    cls1 = np.zeros((2, 11, 11))
    cls2 = np.full((1, 11, 11), -1.0)
    cls2[0, 5, 5] = 1.0
    return loc, cls1, cls2


def test_finds_the_box_again() -> None:
    decoded = decode(*steady_maps(), OLD, 1.0, FRAME, CONFIG)
    assert decoded.best == 60
    assert decoded.box.xywh == pytest.approx(OLD.xywh)
    assert decoded.score == pytest.approx(0.5 * (0.8 * 0.5 + 0.9))
    assert decoded.penalties[60] == pytest.approx(1, abs=1e-4)


def test_follows_the_best_cell_in_frame_pixels() -> None:
    loc, cls1, cls2 = steady_maps()
    cls2[0, 4, 7] = 5.0
    decoded = decode(loc, cls1, cls2, OLD, 2.0, FRAME, CONFIG)
    assert decoded.best == 4 * 11 + 7
    assert (decoded.box.cx_px, decoded.box.cy_px) == pytest.approx((320 + 32 / 2, 240 - 16 / 2))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("which", ["loc", "cls1", "cls2"])
def test_not_finite_cells_are_passed_by(bad: float, which: str) -> None:
    loc, cls1, cls2 = steady_maps()
    {"loc": loc, "cls1": cls1, "cls2": cls2}[which][:, 2, 3] = bad
    decoded = decode(loc, cls1, cls2, OLD, 1.0, FRAME, CONFIG)
    assert decoded.best == 60


def test_turned_over_cells_are_passed_by() -> None:
    loc, cls1, cls2 = steady_maps()
    cls2[0, 2, 3] = 50.0
    assert decode(loc, cls1, cls2, OLD, 1.0, FRAME, CONFIG).best == 2 * 11 + 3
    loc[:, 2, 3] *= -1  # both sizes negative: the authors' formula sees nothing wrong
    assert decode(loc, cls1, cls2, OLD, 1.0, FRAME, CONFIG).best == 60


def test_nothing_usable_keeps_the_old_box() -> None:
    loc, cls1, cls2 = steady_maps()
    for broken in (np.full_like(loc, math.nan), -loc):
        decoded = decode(broken, cls1, cls2, OLD, 1.0, FRAME, CONFIG)
        assert (decoded.box, decoded.best, decoded.score) == (OLD, None, 0.0)


def test_rate_is_clipped_only_on_request() -> None:
    loc, cls1, cls2 = steady_maps()
    loc[:2] = math.tanh(30 / 143)
    cls2[0, 5, 5] = 20.0  # a rate of about 2.7
    free = decode(loc, cls1, cls2, OLD, 1.0, FRAME, CONFIG)
    clipped = decode(loc, cls1, cls2, OLD, 1.0, FRAME, replace(CONFIG, clip_rate=True))
    assert free.box.w_px > 61
    assert clipped.box.w_px == pytest.approx(60)


def test_second_branch_as_a_probability() -> None:
    loc, cls1, cls2 = steady_maps()
    cls2[0, 5, 5] = 20.0
    decoded = decode(loc, cls1, cls2, OLD, 1.0, FRAME, replace(CONFIG, cls2_is_logit=False))
    assert decoded.score == pytest.approx(0.5 * (0.8 * 0.5 + 0.9), abs=1e-6)
    assert decoded.scores.min() > 0


def test_maps_are_not_changed() -> None:
    maps = steady_maps()
    maps[0][:, 0, 0] = 3
    copies = [m.copy() for m in maps]
    decode(*maps, OLD, 1.0, FRAME, CONFIG)
    for mine, copy in zip(maps, copies, strict=True):
        np.testing.assert_array_equal(mine, copy)


floats = st.floats(width=32, allow_nan=True, allow_infinity=True)


@settings(max_examples=60, deadline=None)
@given(
    loc=arrays(np.float32, (4, 11, 11), elements=floats),
    cls=arrays(np.float32, (3, 11, 11), elements=floats),
    scale=st.floats(0.01, 20),
)
def test_any_maps_give_a_box_inside_the_limits(
    loc: NDArray[np.float32], cls: NDArray[np.float32], scale: float
) -> None:
    decoded = decode(loc, cls[:2], cls[2:], OLD, scale, FRAME, CONFIG)
    box = decoded.box
    assert box.is_valid
    assert math.isfinite(decoded.score)
    assert 0 <= box.cx_px <= 640
    assert 0 <= box.cy_px <= 480
    assert 10 <= box.w_px <= 640
    assert 10 <= box.h_px <= 480

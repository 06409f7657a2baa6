"""Losing the target behind something and finding it again, with the weights that ship."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tracker.box import Box
from tracker.crop import Image
from tracker.online import ClimRTTracker
from tracker.weights import DATA, load_network, read_manifest

WIDTH, HEIGHT, SIDE = 640, 360, 36
WALL_LEFT, WALL_WIDTH = 320, 150  # px of the ground
HIDDEN = range(32, 48)  # the frames in which no pixel of the target is to be seen


def picture(seed: int, cells: int, width: int, height: int) -> Image:
    coarse = np.random.default_rng(seed).integers(40, 200, (cells, cells, 3), np.uint8)
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC), np.uint8)


GROUND = picture(1, 16, WIDTH + 200, HEIGHT)
WALL = picture(2, 5, WALL_WIDTH, 200)
TARGET = picture(3, 4, SIDE, SIDE)
TARGET[8:28, 8:28] = (30, 30, 230)


def truth(t: int) -> tuple[float, float]:
    """Centre of the target in frame t, px; the camera pans as well."""
    return 120 + 7.0 * t - 2.0 * t, 180 + 0.5 * t


def frame(t: int, wall: bool = True) -> Image:
    """The target walks to the right, behind a wall."""
    image = GROUND[:, 2 * t : 2 * t + WIDTH].copy()
    x, y = (round(v - SIDE / 2) for v in truth(t))
    image[y : y + SIDE, x : x + SIDE] = TARGET
    if wall:
        left = WALL_LEFT - 2 * t
        image[80:280, left : left + WALL_WIDTH] = WALL
    return image


def test_the_target_is_hidden_wholly_just_then() -> None:
    for t in range(60):
        left, right = (truth(t)[0] + side * SIDE / 2 + 2 * t for side in (-1, 1))
        assert (left >= WALL_LEFT + 0.5 and right <= WALL_LEFT + WALL_WIDTH - 0.5) == (t in HIDDEN), t


@pytest.fixture
def tracker() -> ClimRTTracker:
    path = DATA / "compact.safetensors"
    manifest = read_manifest(path)
    config = replace(manifest.tracker, redetect=True, lost_below=0.5, found_above=0.75, doubt_below=0.4)
    return ClimRTTracker(load_network(path), config, confidence=manifest.confidence)


def track(tracker: ClimRTTracker, frames: int) -> tuple[NDArray[np.float64], list[bool]]:
    """Centre error, px, and whether it was called visible, of each frame."""
    tracker.init(frame(0), Box(*truth(0), SIDE, SIDE))
    errors, visible = [], []
    for t in range(1, frames):
        result = tracker.update(frame(t))
        errors.append(np.hypot(result.box.cx_px - truth(t)[0], result.box.cy_px - truth(t)[1]))
        visible.append(result.visible)
    return np.array(errors), visible


def test_a_target_that_was_hidden_is_found_again(tracker: ClimRTTracker) -> None:
    errors, visible = track(tracker, 80)
    assert all(visible[: HIDDEN.start - 8])  # wholly in sight
    assert not any(visible[HIDDEN.start : HIDDEN.stop - 2])  # a wall is not the target
    assert errors[-10:].max() < SIDE / 2
    assert all(visible[-10:])


def test_while_hidden_it_is_expected_on_its_way(tracker: ClimRTTracker) -> None:
    errors, visible = track(tracker, HIDDEN.start + 9)
    assert not visible[-1]
    # It has gone on for 63 px of the ground; who expects it where it was last seen is that far off.
    assert errors[-1] < 1.2 * SIDE


def test_it_never_comes_back_where_there_is_nothing(tracker: ClimRTTracker) -> None:
    tracker.init(frame(0), Box(*truth(0), SIDE, SIDE))
    for t in range(1, HIDDEN.start):
        tracker.update(frame(t))
    empty = [GROUND[:, 2 * t : 2 * t + WIDTH].copy() for t in range(HIDDEN.start, HIDDEN.start + 20)]
    results = [tracker.update(image) for image in empty]
    assert not any(r.visible for r in results[3:])
    assert all(r.box.is_valid for r in results)


def test_being_told_where_to_look_helps(tracker: ClimRTTracker) -> None:
    """The target comes out far from where it was going; who steers the aircraft knows."""
    tracker.init(frame(0), Box(*truth(0), SIDE, SIDE))
    for t in range(1, HIDDEN.start + 8):
        tracker.update(frame(t))
    image = GROUND[:, 2 * HIDDEN.start : 2 * HIDDEN.start + WIDTH].copy()
    image[300 : 300 + SIDE, 60 : 60 + SIDE] = TARGET
    for _ in range(6):
        tracker.look_at(78.0, 318.0)
        result = tracker.update(image)
    assert result.visible
    assert np.hypot(result.box.cx_px - 78, result.box.cy_px - 318) < SIDE / 2

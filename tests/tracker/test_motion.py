"""Camera and target motion on drawn pictures whose motion is known exactly."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from tracker import motion
from tracker.box import Box
from tracker.crop import Image
from tracker.motion import Homography, StabilisedPath, background_motion, carry, small_grey

NOISE = np.random.default_rng(3).standard_normal((900, 1500, 3))
# Details of all sizes, as the ground has.
WORLD = sum(size * cv2.GaussianBlur(NOISE, (0, 0), size) for size in (3, 10, 40))
WORLD = cv2.normalize(WORLD, None, 0, 255, cv2.NORM_MINMAX, cv2.CV_8U)
OBJECT = np.random.default_rng(4).integers(0, 256, (400, 400, 3), dtype=np.uint8)


def view(similarity: np.ndarray, size: tuple[int, int] = (960, 540)) -> Image:
    """What a camera sees of the world; similarity (2, 3) from world px to picture px."""
    return np.asarray(cv2.warpAffine(WORLD, similarity, size), np.uint8)


def similarity(shift: tuple[float, float], scale: float = 1.0, turn_deg: float = 0.0) -> np.ndarray:
    matrix = cv2.getRotationMatrix2D((700, 450), turn_deg, scale)
    matrix[:, 2] += (-250 + shift[0], -200 + shift[1])
    return np.asarray(matrix)


def paste(image: Image, box: Box) -> Image:
    """The object drawn into the box, to a fraction of a pixel."""
    x, y, w, h = box.xywh
    # Details of about two pixels once drawn, as optics leave them.
    smooth = cv2.GaussianBlur(OBJECT, (0, 0), max(3.0, 800 / max(w, h, 1.0)))
    smooth = cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX)
    matrix = np.array([[w / 400, 0, x], [0, h / 400, y]])
    size = (image.shape[1], image.shape[0])
    drawn = cv2.warpAffine(smooth, matrix, size, dst=image.copy(), borderMode=cv2.BORDER_TRANSPARENT)
    return np.asarray(drawn, np.uint8)


def camera_motion(first: Image, second: Image, exclude: Box | None = None) -> Homography | None:
    before, (after, scale) = small_grey(first)[0], small_grey(second)
    return background_motion(before, after, scale, exclude)


@pytest.mark.parametrize(
    ("shift", "scale", "turn_deg"),
    [((0, 0), 1.0, 0), ((23.5, -11.25), 1.0, 0), ((70, 40), 1.0, 0), ((5, 3), 1.06, 0), ((-8, 4), 0.96, 4)],
)
def test_camera_motion_is_measured_to_a_pixel(shift: tuple[float, float], scale: float, turn_deg: float) -> None:
    first, second = similarity((0, 0)), similarity(shift, scale, turn_deg)
    found = camera_motion(view(first), view(second))
    assert found is not None
    expected = np.vstack([second, (0, 0, 1)]) @ np.linalg.inv(np.vstack([first, (0, 0, 1)]))
    corners = np.array([[100, 100, 1], [860, 100, 1], [480, 270, 1], [100, 440, 1], [860, 440, 1]], float).T
    assert np.abs((found @ corners)[:2] - (expected @ corners)[:2]).max() < 1.0


def test_a_large_target_that_moves_by_itself_does_not_count() -> None:
    still = view(similarity((0, 0)))
    here, there = Box(480, 270, 560, 400), Box(510, 270, 560, 400)
    found = camera_motion(paste(still, here), paste(still, there), here)
    assert found is not None
    assert np.abs(found - np.eye(3)).max() < 0.2
    seen = camera_motion(paste(still, here), paste(still, there))
    assert seen is None or np.abs(seen - np.eye(3)).max() > 10  # so the exclusion is what helps


def test_without_texture_nothing_is_known() -> None:
    blank = np.full((360, 640, 3), 90, np.uint8)
    assert camera_motion(blank, blank) is None


def test_a_cut_to_another_scene_is_not_taken_for_motion() -> None:
    scene = view(similarity((0, 0)))
    assert camera_motion(scene, np.ascontiguousarray(scene[::-1, ::-1])) is None


def test_of_frames_of_different_sizes_nothing_is_known() -> None:
    small = view(similarity((0, 0)), (640, 360))
    assert camera_motion(view(similarity((0, 0))), small) is None
    assert camera_motion(small, view(similarity((3, 0)), (640, 360))) is not None


def test_carry_moves_and_scales_a_box() -> None:
    turn = np.array([[0.0, -2.0, 100.0], [2.0, 0.0, 50.0], [0.0, 0.0, 1.0]])  # 90 degrees, twice as large
    moved = carry(Box(10, 20, 6, 8), turn)
    assert (moved.cx_px, moved.cy_px) == pytest.approx((60, 70))
    assert (moved.w_px, moved.h_px) == pytest.approx((12, 16))
    perspective = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.01, 1.0]])
    shrunk = carry(Box(0, 100, 10, 10), perspective)
    assert shrunk.cy_px == pytest.approx(50)
    assert shrunk.w_px < 5


def test_path_goes_on_over_the_ground_while_the_camera_swings() -> None:
    rng = np.random.default_rng(5)
    path = StabilisedPath(frames=5)
    assert path.expected() is None
    to_picture = np.eye(3)
    for t in range(30):
        swing = np.array([[1, 0, rng.uniform(-30, 30)], [0, 1, rng.uniform(-30, 30)], [0, 0, 1]])
        to_picture = swing @ to_picture
        path.move(swing)
        x, y, _ = to_picture @ (100 + 4 * t, 200 - 3 * t, 1)
        if t <= 10:
            path.observe(x, y)
        assert path.unseen_frames == max(0, t - 10)
        expected = path.expected()
        assert expected is not None
        unseen = max(0, t - 10)
        # Exactly there while it is seen; later it is taken to slow down, and lags by no more than t^2 / 40 frames' way.
        assert math.dist(expected, (x, y)) <= 5 * unseen * unseen / 40 + 1e-6
    assert path.velocity == pytest.approx(tuple(v * math.exp(-19 / motion.PATH_MEMORY_FRAMES) for v in (4, -3)))


def test_path_stops_in_the_end_and_forgets_what_is_long_ago() -> None:
    path = StabilisedPath(frames=2)
    for x in (0, 5):
        path.move(None)
        path.observe(x, 0)
    for _ in range(100):
        path.move(None)
    stopped = path.expected()
    assert stopped is not None
    assert stopped[0] == pytest.approx(5 + 5 * motion.PATH_MEMORY_FRAMES, abs=1)
    path.observe(300, 0)
    assert path.velocity == (0, 0)


def test_small_grey_is_small_and_averages() -> None:
    stripes = np.zeros((720, 1280, 3), np.uint8)
    stripes[:, ::2] = 200
    small, scale = small_grey(stripes)
    assert small.shape == (180, 320)
    assert scale == 0.25
    assert np.abs(small.astype(int) - 100).max() <= 1

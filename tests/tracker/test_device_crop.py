"""The crop made of torch operations gives OpenCV's pixels."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tracker.crop import crop
from tracker.engines.device_crop import cut, plan_crop, used_window

FILL = (1, 200, 77)


def device_crop(frame: np.ndarray, cx: float, cy: float, side: int, out: int) -> np.ndarray:
    plan = plan_crop((frame.shape[1], frame.shape[0]), cx, cy, side, out, FILL)
    patch = cut(torch.from_numpy(frame), torch.from_numpy(plan))
    assert (tuple(patch.shape), patch.dtype) == ((1, out, out, 3), torch.uint8)
    return patch[0].numpy()


@settings(max_examples=400, deadline=None)
@given(
    shape=st.tuples(st.integers(1, 60), st.integers(1, 60)),
    centre=st.tuples(st.floats(-80, 140), st.floats(-80, 140)),
    side=st.integers(1, 200),
    out=st.sampled_from([1, 2, 17, 32, 61]),
    seed=st.integers(0, 9),
)
@example((60, 60), (30.0, 30.0), 34, 17, 0)  # half the size: OpenCV takes means there
@example((60, 60), (30.0, 30.0), 17, 17, 0)
@example((60, 60), (300.0, 30.0), 40, 17, 0)
def test_the_same_pixels_as_the_crop_on_the_cpu(
    shape: tuple[int, int], centre: tuple[float, float], side: int, out: int, seed: int
) -> None:
    frame = np.random.default_rng(seed).integers(0, 256, (*shape, 3), dtype=np.uint8)
    np.testing.assert_array_equal(device_crop(frame, *centre, side, out), crop(frame, *centre, side, out, FILL))


@pytest.mark.parametrize("out", [127, 287])
def test_the_same_pixels_at_the_sizes_of_the_tracker(out: int) -> None:
    rng = np.random.default_rng(3)
    frame = rng.integers(0, 256, (720, 1280, 3), dtype=np.uint8)
    frame[:200] = np.where(frame[:200] > 127, 255, 0)  # full contrast: the sums at their largest
    for side in (1, 2, 40, 126, out - 1, out, out + 1, 2 * out, 3 * out, 719, *rng.integers(3, 1500, 12)):
        cx, cy = rng.uniform(-100, 1380), rng.uniform(-100, 820)
        np.testing.assert_array_equal(
            device_crop(frame, cx, cy, int(side), out), crop(frame, cx, cy, int(side), out, FILL)
        )


def test_a_flat_frame_stays_flat() -> None:
    """Dropped bits may not darken what has one colour, nor the fill beside it."""
    for grey in (0, 1, 127, 254, 255):
        frame = np.full((50, 50, 3), grey, np.uint8)
        assert (device_crop(frame, 25, 25, 37, 61) == grey).all()
    assert (device_crop(np.zeros((50, 50, 3), np.uint8), -70, 25, 37, 61) == FILL).all()


@settings(max_examples=100, deadline=None)
@given(centre=st.tuples(st.floats(-80, 140), st.floats(-80, 140)), side=st.integers(1, 150))
def test_no_pixel_outside_the_used_window_counts(centre: tuple[float, float], side: int) -> None:
    frame = np.random.default_rng(0).integers(0, 256, (50, 60, 3), dtype=np.uint8)
    window = used_window(plan_crop((60, 50), *centre, side, 32, FILL))
    other = np.random.default_rng(1).integers(0, 256, frame.shape, dtype=np.uint8)
    other[window] = frame[window]
    np.testing.assert_array_equal(device_crop(other, *centre, side, 32), device_crop(frame, *centre, side, 32))


def test_a_side_below_one_pixel_is_refused() -> None:
    with pytest.raises(ValueError, match="crop side 0 px: must be at least 1"):
        plan_crop((10, 10), 5, 5, 0, 17, FILL)

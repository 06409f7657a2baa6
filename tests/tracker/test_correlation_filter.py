"""The filter that is learned on line."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from tracker.correlation_filter import (
    REGION,
    CorrelationFilter,
    FilterConfig,
    Response,
    gaussian_label,
    peak_near,
    sample_response,
)

SIDE, CHANNELS = 28, 20


def scene(*placed: tuple[Tensor, int, int], seed: int = 0) -> Tensor:
    """Features (1, C, 28, 28), smooth as the backbone's are, with patterns (C, 3, 3) round cells from the middle."""
    coarse = torch.randn(1, CHANNELS, 7, 7, generator=torch.Generator().manual_seed(seed))
    features = functional.interpolate(coarse, SIDE, mode="bicubic", align_corners=False)
    for pattern, row, column in placed:
        top, left = SIDE // 2 + row - 1, SIDE // 2 + column - 1
        features[0, :, top : top + 3, left : left + 3] = pattern
    return features


def pattern(seed: int) -> Tensor:
    return 3 * torch.randn(CHANNELS, 3, 3, generator=torch.Generator().manual_seed(seed))


def place(row: int, column: int) -> tuple[float, float]:
    """x, y px from the patch's middle of a cell: with an even number of cells the middle is between two."""
    return (column + 0.5) * 8.0, (row + 0.5) * 8.0


TARGET, RIVAL = pattern(1), pattern(2)


def best_place(response: Response) -> tuple[float, float]:
    row, column = np.unravel_index(int(np.argmax(response)), response.shape)
    return (float(column) - (REGION - 1) / 2) * 8, (float(row) - (REGION - 1) / 2) * 8


def learned() -> CorrelationFilter:
    """Knows the target, whose centre is taken for the patch's middle."""
    return CorrelationFilter(scene((TARGET, 0, 0), (RIVAL, 5, 5)), FilterConfig())


def test_the_response_moves_with_the_target_and_not_to_its_rival() -> None:
    knows = learned()
    for row, column in ((0, 0), (3, -4), (-6, 2)):
        response = knows.response(knows.reduce(scene((TARGET, row, column), (RIVAL, 7, -7), seed=9)))
        x, y = best_place(response)
        # Within half a cell: in the first frame the middle of the patch lay between two cells.
        assert abs(x - 8 * column) <= 4
        assert abs(y - 8 * row) <= 4
        assert response.max() > 0.2
    for found, known in ((TARGET, True), (RIVAL, False)):
        response = knows.response(knows.reduce(scene((found, 3, 3), seed=9)))
        at_it = sample_response(response, np.array([24.0]), np.array([24.0]))[0]
        assert (at_it > 0.2) == known


def test_it_learns_a_new_look_but_never_forgets_the_first() -> None:
    knows, new = learned(), pattern(3)
    look = scene((new, 0, 0), seed=4)
    before = knows.response(knows.reduce(look)).max()
    for _ in range(200):
        knows.learn(knows.reduce(look), place(0, 0), frames=5)
    assert knows.response(knows.reduce(look)).max() > max(0.6, 2 * before)
    old = knows.response(knows.reduce(scene((TARGET, 2, 2), seed=7)))
    x, y = best_place(old)
    assert (abs(x - 16) <= 4, abs(y - 16) <= 4) == (True, True)
    assert old.max() > 0.3


def test_one_lesson_of_five_frames_counts_as_five_lessons() -> None:
    one, five = learned(), learned()
    reduced = one.reduce(scene((TARGET, 1, 1), seed=5))
    one.learn(reduced, place(1, 1), frames=5)
    for _ in range(5):
        five.learn(reduced, place(1, 1))
    torch.testing.assert_close(
        torch.from_numpy(one.response(reduced)), torch.from_numpy(five.response(reduced)), rtol=1e-3, atol=1e-4
    )


def test_the_label_peaks_at_the_place_and_samples_back() -> None:
    label = gaussian_label(REGION, REGION, (20.0, -12.0), 1.5, torch.device("cpu")).view(REGION, REGION).numpy()
    x, y, height = peak_near(label, 14.0, -20.0)
    assert abs(x - 20) <= 2
    assert abs(y + 12) <= 2
    assert abs(height - 1) < 0.02
    np.testing.assert_allclose(sample_response(label, np.array([20.0]), np.array([-12.0])), [1.0], atol=0.02)
    assert sample_response(label, np.array([400.0]), np.array([0.0]))[0] == 0


def test_the_peak_is_only_looked_for_nearby() -> None:
    label = gaussian_label(REGION, REGION, (60.0, 0.0), 1.0, torch.device("cpu")).view(REGION, REGION).numpy()
    x, y, height = peak_near(label, 0.0, 0.0)
    assert np.hypot(x, y) <= 16
    assert height < 0.1


def test_forgetting_leaves_the_first_frame() -> None:
    knows, look = learned(), scene((TARGET, 1, 1), seed=5)
    before = knows.response(knows.reduce(look))
    knows.learn(knows.reduce(scene((RIVAL, 0, 0), seed=4)), place(0, 0), frames=50)
    assert np.abs(knows.response(knows.reduce(look)) - before).max() > 0.01
    knows.forget()
    np.testing.assert_array_equal(knows.response(knows.reduce(look)), before)

from __future__ import annotations

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tracker.train.labels import make_labels
from tracker.train.losses import decode_corners, tracking_losses

sides = st.floats(2, 250)
corners = st.floats(-40, 300)


@settings(max_examples=150, deadline=None)
@given(x=corners, y=corners, w=sides, h=sides, seed=st.integers(0, 9))
def test_any_box_has_sound_labels(x: float, y: float, w: float, h: float, seed: int) -> None:
    labels = make_labels((x, y, x + w, y + h), np.random.default_rng(seed))
    assert set(np.unique(labels.cls1)) <= {-2, -1, 0, 1}
    positives = (labels.cls1 == 1).sum()
    assert positives >= 1
    assert (labels.cls1 == 0).sum() <= 2.5 * positives
    assert 0 <= labels.cls2.min() <= labels.cls2.max() <= 1
    assert labels.cls2.max() > 0.9
    assert 0 <= labels.loc_weight.min() <= labels.loc_weight.max() <= 1.5


def test_the_authors_overweight_cells_are_gone() -> None:
    """Cells 4..6 x 3..7: four cells lie exactly on the radius; the authors' code gives them weight 64."""
    box = (63 + 16 * 3, 63 + 16 * 4, 63 + 16 * 7 + 1, 63 + 16 * 6 + 1)
    labels = make_labels(box, np.random.default_rng(0))
    assert labels.loc_weight.max() <= 1.5


def test_a_box_inside_one_cell_marks_it() -> None:
    labels = make_labels((100, 116, 108, 125), np.random.default_rng(0))
    assert np.argwhere(labels.cls1[0] == 1).tolist() == [[3, 2]]
    assert np.argwhere(labels.cls2[0] > 0).tolist() == [[3, 2]]


def test_labels_decode_to_the_box() -> None:
    labels = make_labels((90, 100, 200, 180), np.random.default_rng(0))
    found = decode_corners(torch.from_numpy(labels.loc)[None])[0]
    assert torch.allclose(found, torch.tensor([90.0, 100, 200, 180]).expand(121, 4), atol=1e-2)


def test_turned_over_predictions_give_finite_losses_and_gradients() -> None:
    labels = make_labels((90, 100, 200, 180), np.random.default_rng(0))
    targets = [torch.from_numpy(part)[None] for part in labels]
    cls1, loc_target, cls2, weight = targets
    for value in (-3.0, -0.5, 0.0, 5.0):
        loc = torch.full((1, 4, 11, 11), value, requires_grad=True)
        losses = tracking_losses(
            loc, torch.zeros(1, 2, 11, 11), torch.zeros(1, 1, 11, 11), cls1, loc_target, cls2, weight
        )
        losses.total.backward()
        assert torch.isfinite(losses.total)
        assert 0 <= losses.loc.item() <= 1
        assert loc.grad is not None
        assert torch.isfinite(loc.grad).all()

"""Training targets and losses against the authors' code."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from tests.parity.conftest import Golden
from tracker.train.labels import make_labels
from tracker.train.losses import decode_corners, tracking_losses

NAMES = ("label_cls1", "labelxff", "labelcls2", "weightxff")


@pytest.mark.parametrize("case", range(5))
def test_labels(golden: Golden, case: int) -> None:
    data = golden("e_labels")
    rng = np.random.RandomState(1000 + case)
    labels = make_labels(data[f"{case}_box"], rng, parity=True)
    for name, found in zip(NAMES, labels, strict=True):
        np.testing.assert_allclose(found, data[f"{case}_{name}"], rtol=0, atol=1e-6)


def test_clamped_ring_differs_from_the_wrapped_one(golden: Golden) -> None:
    box = golden("e_labels")["1_box"]  # near the left edge, wide: the authors' ring starts at column -2
    wrapped = make_labels(box, np.random.RandomState(0), parity=True).cls1[0]
    clamped = make_labels(box, np.random.RandomState(0)).cls1[0]
    assert (wrapped == -2).sum() == 3
    assert (clamped[4:7, :10] != 0).all()
    assert (clamped == -2).sum() > 3


def test_losses(golden: Golden) -> None:
    data, labels = golden("f_losses"), golden("e_labels")
    targets = [torch.from_numpy(np.stack([labels[f"{i}_{name}"] for i in (0, 1)])) for name in NAMES]
    outputs = [torch.from_numpy(data[name]) for name in ("loc", "cls1", "cls2")]
    losses = tracking_losses(*outputs, *targets)
    wanted = (("total", losses.total), ("L_cls1", losses.cls1), ("L_cls2", losses.cls2), ("L_loc", losses.loc))
    for name, value in wanted:
        assert float(value) == pytest.approx(float(data[name]), rel=1e-5)
    for name, loc in (("pred_corners", outputs[0]), ("target_corners", targets[1])):
        np.testing.assert_allclose(decode_corners(loc).numpy(), data[name], rtol=0, atol=1e-3)

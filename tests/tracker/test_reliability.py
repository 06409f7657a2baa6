"""Confidence: fitted where the truth is known, it is the truth; and it says how far it can be believed."""

from __future__ import annotations

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.tracker.packs import write_pack
from tracker.box import Box, TrackResult
from tracker.confidence import ConfidenceError, ConfidenceModel
from tracker.train.clips import TruthClip
from tracker.train.pack import Imagery, load
from tracker.train.rehearsal import FRAME_PX, composed_clip, hidden_for_a_while, observe
from tracker.train.reliability import (
    Reliability,
    ReliabilityError,
    cross_validated,
    draw,
    expected_calibration_error,
    fit,
    logistic,
    ranking_auc,
    reliability_curve,
)

TRUE_WEIGHTS, TRUE_BIAS = np.array([1.5, -0.8, 0.0]), 0.4
MODEL = ConfidenceModel(("score", "age"), (2.0, -1.0), 0.5, (0.6, 10.0), (0.2, 5.0))


def drawn(count: int, clips: int = 20, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Observations whose probability is known: features of other scales than 1, right by a thrown coin."""
    rng = np.random.default_rng(seed)
    z = rng.normal(size=(count, 3))
    good = rng.random(count) < 1 / (1 + np.exp(-(z @ TRUE_WEIGHTS + TRUE_BIAS)))
    return z * [0.1, 30, 2] + [0.5, -100, 7], good, rng.integers(clips, size=count)


def test_fit_finds_the_truth() -> None:
    features, good, groups = drawn(20_000)
    found = fit(features, good, groups, ("a", "b", "c"))
    assert found.model.weights == pytest.approx(TRUE_WEIGHTS, abs=0.08)
    assert found.model.bias == pytest.approx(TRUE_BIAS, abs=0.08)
    assert found.ece < 0.02
    assert found.groups == 20
    at = [0.5 + 0.1, -100.0, 7.0]  # one deviation up in the first feature
    assert found.model.probability(at) == pytest.approx(1 / (1 + math.exp(-1.9)), abs=0.03)


def test_features_that_say_nothing_give_the_base_rate() -> None:
    rng = np.random.default_rng(1)
    good = rng.random(4000) < 0.7
    found = fit(rng.normal(size=(4000, 2)), good, rng.integers(10, size=4000))
    assert found.model.probability([0.0, 0.0]) == pytest.approx(0.7, abs=0.03)
    assert found.auc == pytest.approx(0.5, abs=0.05)


def test_leaving_clips_out_shows_what_was_learned_by_heart() -> None:
    """A feature that names the clip predicts within clips and nothing beyond them."""
    rng = np.random.default_rng(2)
    groups = np.repeat(np.arange(10), 100)
    good = (groups % 2 == 0) ^ (rng.random(1000) < 0.05)
    by_heart = (groups[:, None] == np.arange(10)).astype(float)
    found = fit(by_heart, good, groups)
    assert found.ece > 0.3
    assert found.auc < 0.6


def test_every_observation_is_judged_by_a_model_that_never_saw_its_clip() -> None:
    features, good, groups = drawn(300, clips=3)
    before = cross_validated(features, good, groups)
    flipped = np.where(groups == 1, ~good, good)
    after = cross_validated(features, flipped, groups)
    assert (before[groups == 1] == after[groups == 1]).all()
    assert (before[groups == 0] != after[groups == 0]).all()


def test_separable_and_constant_features_stay_finite() -> None:
    x = np.linspace(-1, 1, 200)
    found = fit(np.stack([x, np.full(200, 3.0)], 1), x > 0, np.arange(200) % 5)
    assert np.isfinite(found.model.weights).all()
    assert found.model.weights[1] == pytest.approx(0, abs=1e-9)
    assert found.model.probability([1.0, 3.0]) > 0.99
    assert found.model.probability([-1.0, 3.0]) < 0.01


def test_logistic_is_at_the_minimum() -> None:
    features, good, _ = drawn(500)
    x = (features - features.mean(0)) / features.std(0)
    w = logistic(x, good, ridge=0.01)
    x1 = np.hstack([x, np.ones((500, 1))])
    slope = x1.T @ (1 / (1 + np.exp(-x1 @ w)) - good) + 0.01 * 500 * np.append(w[:3], 0)
    assert np.abs(slope).max() < 1e-3


def test_calibration_error_of_known_answers() -> None:
    confidence = np.array([0.9] * 10 + [0.1] * 10)
    good = np.array([True] * 9 + [False] + [True] + [False] * 9)
    assert expected_calibration_error(confidence, good) == pytest.approx(0)
    assert expected_calibration_error(np.full(20, 0.9), good) == pytest.approx(0.4)
    assert expected_calibration_error(np.array([1.0, 0.0]), np.array([True, False])) == 0
    assert [b.count for b in reliability_curve(confidence, good)] == [10, 10]
    assert ranking_auc(confidence, good) == pytest.approx(0.9)
    assert ranking_auc(np.zeros(20), good) == 0.5


@pytest.mark.parametrize(
    ("features", "good", "groups", "said"),
    [
        (np.zeros((4, 2)), [True] * 4, [0, 0, 1, 1], "4 of 4 observations"),
        (np.zeros((4, 2)), [True, False] * 2, [0] * 4, "one clip only"),
        (np.zeros((4, 2)), [True, False], [0, 1], "do not fit together"),
        (np.full((4, 2), np.nan), [True, False] * 2, [0, 1] * 2, "0 of 0"),
    ],
)
def test_what_cannot_be_fitted_is_said(features: np.ndarray, good: list, groups: list, said: str) -> None:
    with pytest.raises(ReliabilityError, match=said):
        fit(features, np.array(good), np.array(groups))


def test_reliability_survives_json_and_is_a_model_for_flight(tmp_path: Path) -> None:
    found = fit(*drawn(400))
    values = json.loads(json.dumps(found.to_dict()))
    assert Reliability.from_dict(values) == found
    assert ConfidenceModel.from_dict(values) == found.model
    with pytest.raises(ReliabilityError, match="incomplete"):
        Reliability.from_dict({k: v for k, v in values.items() if k != "ece"})
    assert cv2.imread(str(draw(found, tmp_path / "reliability.png"))) is not None


def test_probability_by_hand() -> None:
    assert MODEL.probability([0.8, 15.0]) == pytest.approx(1 / (1 + math.exp(-(2.0 - 1.0 + 0.5))))
    assert MODEL.probability([1e9, 0.0]) == 1
    assert MODEL.probability([-1e9, 0.0]) == 0
    assert MODEL.probability([math.nan, 0.0]) == 0
    assert MODEL.probability([math.inf, 0.0]) == 0
    with pytest.raises(ConfidenceError, match="3 features where 2"):
        MODEL.probability([1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"weights": [1.0]}, "1 weights"),
        ({"scale": [1.0, 0.0]}, "over 0"),
        ({"bias": math.nan}, "finite"),
        ({"mean": None}, "malformed"),
        ({"names": []}, "0 features"),
    ],
)
def test_broken_models_are_refused(change: dict, said: str) -> None:
    with pytest.raises(ConfidenceError, match=said):
        ConfidenceModel.from_dict(MODEL.to_dict() | change)


# -- observing ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def imagery(tmp_path_factory: pytest.TempPathFactory) -> Imagery:
    return load([write_pack(tmp_path_factory.mktemp("packs") / "pack")])


def test_composed_clips_begin_in_sight_and_are_repeatable(imagery: Imagery) -> None:
    hidden = 0
    for seed in range(12):
        clip = composed_clip(imagery, seed, frames=16)
        assert np.isfinite(clip.truth_xywh[0]).all()
        assert clip.images[0].shape == (FRAME_PX, FRAME_PX, 3)
        seen = clip.truth_xywh[~np.isnan(clip.truth_xywh).any(1)]
        assert (seen[:, :2] >= 0).all()
        assert (seen[:, :2] + seen[:, 2:] <= FRAME_PX).all()
        hidden += len(clip) > len(seen)
    assert 2 < hidden < 12
    again = composed_clip(imagery, 11, frames=16)
    assert (again.images[7] == clip.images[7]).all()
    assert again.truth_xywh == pytest.approx(clip.truth_xywh, nan_ok=True)


def test_composed_truth_lies_on_the_target(imagery: Imagery) -> None:
    """The pack's objects are pure red: red is in the middle of the box while it is seen whole."""
    checked = 0
    for seed in range(12):
        clip = composed_clip(imagery, seed, frames=2)
        x, y, w, h = clip.truth_xywh[0]
        b, g, r = (int(v) for v in clip.images[0][round(y + h / 2), round(x + w / 2)])
        checked += r > 200 and b < 70 and g < 70
    assert checked == 12


def test_hiding_covers_the_target_and_says_so() -> None:
    images = [np.full((100, 100, 3), 50, np.uint8) for _ in range(20)]
    clip = TruthClip("plain", images, np.array([[40.0, 40, 20, 10]] * 20))
    hidden = hidden_for_a_while(clip, np.full((30, 30, 3), 200, np.uint8), np.random.default_rng(0))
    absent = np.isnan(hidden.truth_xywh).any(1)
    assert 3 < absent.sum() < 12
    assert not absent[:2].any()
    for image, gone in zip(hidden.images, absent, strict=True):
        assert (image[40:50, 40:60] == (200 if gone else 50)).all()
    assert all((image == 50).all() for image in images)  # the clip itself is left as it was


def test_observing_tells_right_from_wrong_and_absent() -> None:
    class Still:
        def init(self, _image: object, box: Box) -> None:
            self.box = box

        def update(self, _image: object) -> TrackResult:
            return TrackResult(self.box, 0.8, 0.5)

    images = [np.zeros((50, 50, 3), np.uint8)] * 4
    truth = np.array([[10.0, 10, 10, 10], [11, 10, 10, 10], [30, 30, 10, 10], [np.nan] * 4])
    clip = TruthClip("still", images, truth)
    seen = observe(Still(), [clip, clip], lambda result: (result.score, result.confidence))
    assert seen.good.tolist() == [True, False, False] * 2
    assert seen.features.tolist() == [[0.8, 0.5]] * 6
    assert set(seen.groups) == {"still"}

"""Lines for people and programs, and figures."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.tracker.eval_sets import truth
from tracker.eval.benchmark import Results
from tracker.eval.latency import LateOutcome
from tracker.eval.ope import curves, score
from tracker.eval.plots import plot_all
from tracker.eval.report import attribute_lines, late_lines, mean_line, outcome_line
from tracker.eval.run import Outcome
from tracker.eval.sequences import Sequence

NAN = float("nan")


def outcome(name: str, offset_px: float, fps: float = 50.0) -> Outcome:
    boxes = truth(6) + np.array([offset_px, 0, 0, 0])
    return Outcome(name, boxes, score(boxes, truth(6)), fps)


@pytest.fixture
def sequences() -> tuple[Sequence, ...]:
    one = Sequence("one", Path("one"), truth(6), attributes=("SV", "ARC"))
    return one, Sequence("two", Path("two"), truth(6), attributes=("SV",))


@pytest.fixture
def trackers() -> list[Results]:
    ours = Results("ours", (outcome("one", 0), outcome("two", 30, 70)))
    return [ours, Results("theirs", (outcome("one", 30, NAN),))]


def test_json_lines_end_with_the_mean(trackers: list[Results]) -> None:
    first = json.loads(outcome_line(trackers[0].outcomes[0], as_json=True))
    assert first["sequence"] == "one"
    assert first["precision"] == 1
    mean = json.loads(mean_line(trackers[0], as_json=True))
    assert mean["sequence"] == "mean"
    assert (mean["precision"], mean["fps"], mean["sequences"]) == (pytest.approx((1 + 1 / 6) / 2, abs=1e-4), 60, 2)
    assert mean["auc"] == pytest.approx((20 / 21 + 20 / 21 / 6) / 2, abs=1e-4)
    theirs = json.loads(mean_line(trackers[1], as_json=True, named=True))
    assert (theirs["tracker"], theirs["fps"]) == ("theirs", None)


def test_text_has_the_valid_frames_beside_the_benchmarks_columns(trackers: list[Results]) -> None:
    line = mean_line(trackers[0], as_json=False)
    assert line.split() == ["mean", "(2)", "0.5556", "0.5833", "|", "0.5556", "0.5833", "60.0"]
    assert mean_line(trackers[1], as_json=False, named=True).startswith("theirs (1)")


def test_attributes_are_means_over_the_sequences_that_have_them(
    sequences: tuple[Sequence, ...], trackers: list[Results]
) -> None:
    rows = [json.loads(line) for line in attribute_lines(sequences, trackers, as_json=True)]
    ours = {row["attribute"]: row["precision"] for row in rows if row["tracker"] == "ours"}
    assert ours == {"ARC": 1.0, "SV": pytest.approx(0.5833, abs=1e-4)}
    text = list(attribute_lines(sequences, trackers, as_json=False))
    assert text[1].split() == ["ARC", "aspect", "ratio", "change", "(1)", "1.000", "/", "0.952", "0.167", "/", "0.159"]
    bare = (Sequence("one", Path("one"), truth(6)),)
    assert list(attribute_lines(bare, trackers, as_json=False)) == ["attributes: this data set has none on disk"]


def test_the_latency_table(trackers: list[Results]) -> None:
    assert list(late_lines(trackers[0])) == []
    one = trackers[0].outcomes[0]
    late = LateOutcome(one.boxes_xywh, one.boxes_xywh, score(truth(6) + 30, truth(6)), one.score, 0.25, 30.0)
    ours = Results("ours", (Outcome("one", one.boxes_xywh, one.score, 50.0, late=late),))
    lines = list(late_lines(ours))
    assert [line.split()[-1] for line in lines[1:4]] == ["1.000", "0.167", "1.000"]
    assert lines[4] == "  frames skipped 25.0 % (frames arrive at 30 fps)"
    row = json.loads(mean_line(ours, as_json=True))
    assert (row["precision_late"], row["precision_predicted"], row["skipped"]) == (0.1667, 1.0, 0.25)


def test_figures_of_all_of_each_attribute_and_of_each_sequence(
    tmp_path: Path, sequences: tuple[Sequence, ...], trackers: list[Results]
) -> None:
    written = {path.name for path in plot_all(tmp_path, "set", sequences, trackers, attributes=True)}
    pairs = {f"{kind}{ending}.png" for kind in ("success", "precision") for ending in ("", "_SV", "_ARC")}
    assert written == pairs | {"cle_one.png", "cle_two.png"}
    for name in written:
        picture = cv2.imread(str(tmp_path / name))
        assert picture is not None
        assert picture.min() < 100 < picture.max()
    lost, held = (np.mean(cv2.imread(str(tmp_path / f"cle_{name}.png")), axis=(0, 1)) for name in ("two", "one"))
    assert lost[0] < held[0] - 5  # shaded red: less blue


def test_curves_agree_with_the_score() -> None:
    boxes = truth(6) + np.array([5.0, 0, 0, 0])
    boxes[0] = truth(1)[0]
    curve, value = curves(boxes, truth(6)), score(boxes, truth(6))
    assert curve.success.mean() == pytest.approx(value.auc)
    assert curve.precision[20] == value.precision
    assert curve.precision[4] == pytest.approx(1 / 6)
    assert curve.precision[5] == 1

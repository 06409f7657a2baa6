"""Scores against published figures and against cases worked out by hand."""

from pathlib import Path

import numpy as np
import pytest

from tracker.eval.ope import fill_invalid, mean_score, overlaps, score
from tracker.eval.sequences import SequenceError, load_dataset, read_boxes

SHARED_EVAL = Path(__file__).parents[3] / "shared" / "data" / "eval"


def test_perfect_result_scores_twenty_of_twenty_one() -> None:
    boxes = np.tile([10.0, 20.0, 30.0, 40.0], (5, 1))
    result = score(boxes, boxes)
    assert result.auc == pytest.approx(20 / 21)  # IoU > 1 is never true
    assert result.precision == 1.0


def test_iou_of_a_half_shifted_box() -> None:
    a, b = np.array([[0.0, 0, 10, 10]]), np.array([[5.0, 0, 10, 10]])
    assert overlaps(a, b)[0] == pytest.approx(50 / 150)


def test_absent_frames_are_a_miss_in_success_and_a_hit_in_precision() -> None:
    truth = np.array([[0.0, 0, 10, 10], [np.nan] * 4])
    boxes = np.array([[0.0, 0, 10, 10], [500.0, 500, 10, 10]])
    result = score(boxes, truth)
    assert result.precision == 1.0
    assert result.auc == pytest.approx(20 / 21 / 2)
    assert result.auc_valid == pytest.approx(20 / 21)


def test_invalid_rows_repeat_the_row_before() -> None:
    filled = fill_invalid(np.array([[1.0, 2, 3, 4], [np.nan] * 4, [5.0, 5, 0, 5]]))
    assert (filled == [1.0, 2, 3, 4]).all()


def test_lengths_that_differ_are_refused() -> None:
    with pytest.raises(ValueError, match="2 result boxes against 3"):
        score(np.ones((2, 4)), np.ones((3, 4)))


def test_broken_box_file_names_file_and_line(tmp_path: Path) -> None:
    path = tmp_path / "boxes.txt"
    path.write_text("1,2,3,4\n1,2,x,4\n")
    with pytest.raises(SequenceError, match=r"boxes\.txt line 2"):
        read_boxes(path)


def test_folder_without_sequences_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SequenceError, match="no index"):
        load_dataset(tmp_path)


@pytest.mark.skipif(not SHARED_EVAL.exists(), reason="the published boxes of AutoTrack are not on this machine")
def test_published_figures_of_autotrack_are_reproduced() -> None:
    annotations = SHARED_EVAL / "uav123_10fps"
    scores = []
    for file in sorted((SHARED_EVAL / "boxes" / "AutoTrack").glob("*.txt")):
        truth = np.genfromtxt(next(annotations.rglob(file.name)), delimiter=",")
        boxes = np.array([[float(v) for v in line.replace(",", " ").split()] for line in file.read_text().splitlines()])
        scores.append(score(boxes[: len(truth)], truth))
    mean = mean_score(scores)
    assert len(scores) == 123
    assert (mean.auc, mean.precision) == (pytest.approx(0.4774, abs=1e-4), pytest.approx(0.6714, abs=1e-4))
    assert (mean.auc_valid, mean.precision_valid) == (pytest.approx(0.4821, abs=1e-4), pytest.approx(0.6540, abs=1e-4))

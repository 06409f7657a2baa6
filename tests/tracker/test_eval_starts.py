"""First boxes that are a little off."""

from pathlib import Path

import numpy as np
import pytest

from tests.tracker.eval_sets import MovingTracker, sequence_folder
from tracker.box import Box
from tracker.eval.datasets import read_dataset
from tracker.eval.run import Job
from tracker.eval.starts import EXACT, SRE


def test_twelve_of_their_own_name_none_of_them_exact() -> None:
    box = Box(100.0, 50.0, 20.0, 10.0)
    drawn = {start.name: start.of(box) for start in SRE}
    assert len(drawn) == len(set(drawn.values())) == 12
    assert box not in drawn.values()
    assert EXACT.of(box) == box
    assert drawn["left"] == Box(98.0, 50.0, 20.0, 10.0)
    assert drawn["down-right"] == Box(102.0, 51.0, 20.0, 10.0)
    assert drawn["scale-0.8"] == Box(100.0, 50.0, 16.0, 8.0)
    for axis in ("cx_px", "cy_px", "w_px", "h_px"):  # off to no side on the whole
        assert np.mean([getattr(each, axis) for each in drawn.values()]) == pytest.approx(getattr(box, axis))


def test_the_tracker_begins_there_and_is_scored_against_the_truth(tmp_path: Path) -> None:
    sequence_folder(tmp_path / "set", "a", 6)
    (sequence,) = read_dataset(tmp_path / "set").sequences
    exact = Job(MovingTracker).run(sequence)
    right = next(start for start in SRE if start.name == "right")
    off = Job(MovingTracker, start=right).run(sequence)
    assert off.boxes_xywh[0, 0] - exact.boxes_xywh[0, 0] == pytest.approx(0.1 * exact.boxes_xywh[0, 2])
    assert off.score.auc < exact.score.auc

"""The virtual clock, against schedules worked out by hand."""

from pathlib import Path

import numpy as np
import pytest

from tests.tracker.eval_sets import MovingTracker, sequence_folder
from tracker.eval.latency import ConstantVelocity, LatencyConfig, boxes_in_time, replay, track_late
from tracker.eval.run import Job, run_sequence
from tracker.eval.sequences import Sequence, load_dataset


def numbered(took_s: float, seen: list[int] | None = None):
    """Looks that say the frame's number as x, and take so long; the first takes no time."""

    def look(frame: int) -> tuple[np.ndarray, float]:
        if seen is not None:
            seen.append(frame)
        return np.array([10.0 * frame, 0, 4, 4]), took_s * (frame > 0)

    return look


def shown(took_s: float, count: int = 6, fps: float = 10.0, **kw: object) -> list[float]:
    """x at each frame's time, in frames."""
    return (boxes_in_time(replay(numbered(took_s), count, fps), count, fps, **kw)[:, 0] / 10).tolist()  # type: ignore[arg-type]


def test_even_a_fast_tracker_is_one_frame_late() -> None:
    assert shown(0.012) == [0, 0, 1, 2, 3, 4]


def test_an_answer_just_in_time_for_the_next_frame_counts() -> None:
    assert shown(0.1) == [0, 0, 1, 2, 3, 4]


def test_a_slow_tracker_skips_to_the_newest_frame() -> None:
    seen: list[int] = []
    answers = replay(numbered(0.25, seen), 9, 10.0)
    # 1 is done at .35 and 3 is the newest then; 3 at .60: 6; 6 at .85: 8.
    assert seen == [0, 1, 3, 6, 8]
    assert [round(a.finished_s, 3) for a in answers] == [0, 0.35, 0.6, 0.85, 1.1]
    assert shown(0.25, 9) == [0, 0, 0, 0, 1, 1, 3, 3, 3]


def test_a_burst_of_slowness_is_caught_up_with() -> None:
    times_s = {1: 0.32}
    answers = replay(lambda k: (np.full(4, float(k)), times_s.get(k, 0.01)), 8, 10.0)
    assert [a.frame for a in answers] == [0, 1, 4, 5, 6, 7]


def test_constant_velocity_makes_up_for_the_delay() -> None:
    assert shown(0.012, predictor=ConstantVelocity())[2:] == pytest.approx([2, 3, 4, 5])
    assert shown(0.25, 9, predictor=ConstantVelocity())[4:] == pytest.approx([4, 5, 6, 7, 8])


def test_prediction_keeps_sides_positive() -> None:
    predictor = ConstantVelocity()
    predictor.observe(0.0, np.array([0.0, 0, 20, 20]))
    predictor.observe(0.1, np.array([0.0, 0, 5, 20]))
    assert predictor.predict(0.2)[2] == 1.0


@pytest.fixture
def moving(tmp_path: Path) -> Sequence:
    sequence_folder(tmp_path, "moving", 20)
    return load_dataset(tmp_path)[0]


def test_a_tracker_in_time_is_not_run_again(moving: Sequence) -> None:
    offline = run_sequence(MovingTracker(), moving)

    def never() -> MovingTracker:
        raise AssertionError("run again")

    late = track_late(never, moving, offline.boxes_xywh, np.full(20, 0.01), LatencyConfig(30.0))
    assert late.skipped == 0
    assert late.predicted_score.auc > late.score.auc
    np.testing.assert_allclose(late.boxes_xywh[2:, 0], moving.truth_xywh[1:-1, 0])


def test_a_slow_machine_sees_fewer_frames_and_is_scored_late(moving: Sequence) -> None:
    class Timed(MovingTracker):
        slow_s = 0.002

    job = Job(Timed, latency=LatencyConfig(30.0, slower=100.0))
    outcome = job.run(moving)
    late = outcome.late
    assert outcome.score.precision == 1.0
    assert late is not None
    assert 0.5 < late.skipped < 1
    assert late.score.auc < outcome.score.auc
    assert late.boxes_xywh.shape == (20, 4)

"""The frames that are kept: all of two seconds, or fewer of the same two seconds where they are large."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.video import Frame
from gcs.video.catch_up import next_frame
from gcs.video.history import KEPT_BYTES, KEPT_S, FrameHistory

FPS = 30.0


def frame(seq: int, width_px: int = 8, height_px: int = 8) -> Frame:
    # A picture that takes no memory, but tells its size.
    image = np.broadcast_to(np.zeros((1, 1, 1), np.uint8), (height_px, width_px, 3))
    return Frame(seq, image, seq / FPS - 0.1, seq / FPS)


def filled(count: int, width_px: int = 8, height_px: int = 8) -> FrameHistory:
    history = FrameHistory()
    for seq in range(count):
        history.add(frame(seq, width_px, height_px))
    return history


def test_two_seconds_are_kept() -> None:
    history = filled(100)
    assert [each.seq for each in history.since(-1)] == list(range(39, 100))
    assert [each.seq for each in history.since(97)] == [98, 99]
    assert history.since(99) == []
    assert history.newest is not None
    assert history.newest.seq == 99


def test_frames_by_number_and_by_time() -> None:
    history = filled(100)
    for seq in (39, 70, 99):
        found = history.by_seq(seq)
        assert found is not None
        assert found.seq == seq
    assert history.by_seq(38) is None
    assert history.by_seq(100) is None
    at = history.at(70.5 / FPS)
    assert at is not None
    assert at.seq == 70
    oldest = history.at(0.0)
    assert oldest is not None
    assert oldest.seq == 39


def test_an_empty_history_has_nothing() -> None:
    history = FrameHistory()
    assert (history.newest, history.by_seq(0), history.at(1.0), history.since(-1)) == (None, None, None, [])


@pytest.mark.parametrize(("width_px", "height_px", "step"), [(1280, 720, 1), (1920, 1080, 2), (3840, 2160, 8)])
@pytest.mark.parametrize("count", [90, 300, 301, 302])
def test_large_pictures_are_thinned_out_and_reach_as_far_back(
    width_px: int, height_px: int, step: int, count: int
) -> None:
    history = filled(count, width_px, height_px)
    kept = history.since(-1)
    assert sum(each.image_bgr.nbytes for each in kept) <= KEPT_BYTES
    gaps = np.diff([each.seq for each in kept])
    assert gaps.max() <= step
    assert kept[-1].seq == count - 1
    assert kept[-1].t_arrival_s - kept[0].t_arrival_s > KEPT_S - (step + 1) / FPS


def test_a_frame_that_was_thinned_out_is_told_by_its_neighbour() -> None:
    history = filled(300, 3840, 2160)
    kept = {each.seq for each in history.since(-1)}
    for seq in range(min(kept), 300):
        found = history.by_seq(seq)
        assert found is not None
        assert abs(found.seq - seq) <= 4
        assert seq not in kept or found.seq == seq


def test_catching_up_takes_small_steps_while_there_is_time() -> None:
    waiting = [frame(seq) for seq in range(1, 19)]

    def step(update_s: float, left_s: float) -> int:
        found = next_frame(waiting, 0.0, update_s, left_s)
        assert found is not None
        return found.seq

    assert step(0.0, 0.5) == 1  # nothing known of the tracker yet
    assert step(0.010, 0.5) == 1
    assert step(0.030, 0.5) == 2  # 0.6 s behind, 17 updates: 0.034 s each and the 0.030 s that pass meanwhile
    assert step(0.030, 0.1) == 6
    assert step(0.030, -1.0) == 10
    assert next_frame([], 0.0, 0.01, 0.5) is None

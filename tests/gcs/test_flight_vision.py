"""Eyes of a flight: selections, failures of the tracker, pictures that stand still."""

from __future__ import annotations

import threading

import pytest

from gcs.clock import FakeClock
from gcs.flight_vision import Seen, StillPicture, Vision
from gcs.video import Frame
from gcs.video.frame import Image
from tests.gcs.vision_doubles import BOX, Source, Tracker, picture
from tracker.box import Box, TrackResult


@pytest.fixture
def vision() -> Vision:
    return Vision(Source(), Tracker(), FakeClock(1.0), lambda seen: None)


def test_nothing_is_tracked_before_a_selection(vision: Vision) -> None:
    seen = vision.step(picture(0))
    assert (seen.selection, seen.result, seen.problem) == (0, None, None)


def test_a_box_is_tracked_from_the_picture_it_was_drawn_on(vision: Vision) -> None:
    drawn = picture(3)
    number = vision.select(BOX, drawn)
    seen = vision.step(picture(6))
    assert seen.selection == number == 1
    assert seen.result == TrackResult(BOX, 1.0, 1.0)
    tracker: Tracker = vision._tracker  # type: ignore[assignment]
    assert tracker.began[0][0] is drawn.image_bgr
    assert vision.step(picture(7)).selection == 1
    assert len(tracker.began) == 1


def test_deselecting_ends_the_track(vision: Vision) -> None:
    vision.select(BOX)
    vision.step(picture(0))
    vision.select(None)
    seen = vision.step(picture(1))
    assert (seen.selection, seen.result) == (0, None)


def test_a_box_that_cannot_be_tracked_is_told_under_its_number(vision: Vision) -> None:
    number = vision.select(Box(50.0, 40.0, 2.0, 2.0))
    seen = vision.step(picture(0))
    assert (seen.selection, seen.problem) == (number, "the box is too small")
    assert vision.step(picture(1)).selection == 0


def test_a_failing_tracker_ends_the_track_and_not_the_thread(vision: Vision) -> None:
    vision.select(BOX)
    vision.step(picture(0))
    tracker: Tracker = vision._tracker  # type: ignore[assignment]
    tracker.fault = MemoryError("no memory")
    seen = vision.step(picture(1))
    assert seen.result is None
    assert seen.problem == "the tracker failed: MemoryError"
    tracker.fault = None
    assert vision.step(picture(2)).result is None  # a new selection is needed
    vision.select(BOX)
    assert vision.step(picture(3)).result is not None


def test_a_repeated_picture_counts_as_no_picture_after_half_a_second(vision: Vision) -> None:
    vision.select(BOX)
    frozen = [vision.step(Frame(n, picture(0).image_bgr, n * 0.05, n * 0.05)).frozen for n in range(15)]
    assert frozen.index(True) == 10
    assert not vision.step(Frame(15, picture(9).image_bgr, 0.75, 0.75)).frozen


def test_a_fast_camera_is_not_frozen_for_ten_equal_pictures() -> None:
    still = StillPicture()
    assert not any(still.update(7, n * 0.01) for n in range(20))


def test_the_thread_delivers_every_frame_and_closes_the_video() -> None:
    delivered: list[Seen] = []
    done = threading.Event()

    def deliver(seen: Seen) -> None:
        delivered.append(seen)
        if len(delivered) == 3:
            done.set()

    source = Source(picture(n) for n in range(3))
    vision = Vision(source, Tracker(), FakeClock(), deliver)
    vision.start()
    assert done.wait(5.0)
    vision.close()
    assert [seen.frame.seq for seen in delivered] == [0, 1, 2]
    assert source.closed


def test_a_hidden_target_is_looked_for_where_the_filter_expects_it() -> None:
    tracker, asked = Tracker(), []

    def expect(t_capture_s: float, like: Box) -> Box | None:
        asked.append((t_capture_s, like))
        return Box(30.0, 40.0, 10.0, 10.0) if len(asked) == 1 else None

    vision = Vision(Source(), tracker, FakeClock(1.0), lambda seen: None, expect)
    vision.select(BOX)
    vision.step(picture(0))
    tracker.visible = False
    vision.step(picture(1))
    assert asked == []  # it was still seen before this frame
    vision.step(picture(2))
    vision.step(picture(3))  # the filter knows nothing now
    tracker.visible = True
    assert tracker.looked_at == [(30.0, 40.0)]
    assert asked == [(picture(2).t_capture_s, BOX), (picture(3).t_capture_s, BOX)]


class Learning(Tracker):
    """Notes what it does, and fails in a lesson where told to."""

    def __init__(self, did: list[str], fault: Exception | None) -> None:
        super().__init__()
        self.did, self.lesson_fault = did, fault

    def update(self, frame_bgr: Image) -> TrackResult:
        self.did.append("update")
        return super().update(frame_bgr)

    def learn(self) -> None:
        self.did.append("learn")
        if self.lesson_fault is not None:
            raise self.lesson_fault


@pytest.mark.parametrize("fault", [None, RuntimeError("no memory")])
def test_a_lesson_comes_after_the_answer_is_out(fault: Exception | None) -> None:
    did: list[str] = []
    frames = [picture(seq) for seq in range(1, 4)]
    vision = Vision(Source(frames), Learning(did, fault), FakeClock(), lambda seen: did.append("delivered"))
    vision.select(BOX)
    vision.start()
    while vision._thread.is_alive():
        vision._thread.join(0.1)
    # The first picture passes by while the selection catches up.
    assert did == ["delivered", *(["update", "delivered", "learn"] * 2)]

"""Eyes of a flight: selections, failures of the tracker, pictures that stand still."""

from __future__ import annotations

import threading
from collections.abc import Iterable

import cv2
import numpy as np
import pytest

from gcs.clock import FakeClock
from gcs.flight_vision import Seen, StillPicture, Vision
from gcs.video import Frame
from gcs.video.catch_up import CATCH_UP_S
from gcs.video.frame import Image
from tracker.box import Box, TrackResult
from tracker.weights import load_tracker

BOX = Box(50.0, 40.0, 20.0, 10.0)
SIDE_PX = 36


class Source:
    """A live source that gives what it is told to."""

    name = "test"
    is_live = True
    fps = 20.0
    size = (100, 80)
    frame_count = None
    problem = None

    def __init__(self, frames: Iterable[Frame] = ()) -> None:
        self._frames = iter(frames)
        self.ended = False
        self.closed = False

    def read(self, timeout_s: float | None = None) -> Frame | None:
        frame = next(self._frames, None)
        self.ended = frame is None
        return frame

    def close(self) -> None:
        self.closed = True


class Tracker:
    """Remembers the pictures it was given; fails when told to."""

    def __init__(self) -> None:
        self.began: list[tuple[Image, Box]] = []
        self.fault: Exception | None = None
        self.visible = True
        self.looked_at: list[tuple[float, float]] = []
        self.updated: list[int] = []

    def init(self, frame_bgr: Image, box: Box) -> None:
        if box.w_px < 5:
            raise ValueError("the box is too small")
        self.began.append((frame_bgr, box))

    def update(self, frame_bgr: Image) -> TrackResult:
        if self.fault is not None:
            raise self.fault
        self.updated.append(int(frame_bgr[0, 0, 0]))
        return TrackResult(BOX, 1.0, 1.0, self.visible)

    def look_at(self, cx_px: float, cy_px: float) -> None:
        self.looked_at.append((cx_px, cy_px))


def picture(seq: int) -> Frame:
    image = np.full((80, 100, 3), seq % 256, np.uint8)
    return Frame(seq, image, seq * 0.05 - 0.1, seq * 0.05)


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


class Scene:
    """A live source on a fake clock: a small target on a textured ground, one box width in three frames."""

    name, is_live, fps, size, frame_count, ended, problem, trouble = (
        "scene",
        True,
        30.0,
        (640, 360),
        None,
        False,
        None,
        "",
    )

    def __init__(self, clock: FakeClock) -> None:
        self._clock = clock
        self._ground = texture(1, 16, 640, 360)
        self._target = texture(3, 4, SIDE_PX, SIDE_PX)
        self._target[8:28, 8:28] = (30, 30, 230)
        self._given = -1

    def truth(self, seq: int) -> Box:
        return Box(60.0 + SIDE_PX / 3 * seq, 180.0, SIDE_PX, SIDE_PX)

    def frame(self, seq: int) -> Frame:
        image, box = self._ground.copy(), self.truth(seq)
        x, y = round(box.cx_px - SIDE_PX / 2), round(box.cy_px - SIDE_PX / 2)
        image[y : y + SIDE_PX, x : x + SIDE_PX] = self._target
        return Frame(seq, image, seq / 30.0, seq / 30.0)

    def read(self, timeout_s: float | None = None) -> Frame | None:
        newest = int(self._clock.now_s() * 30.0 + 1e-6)
        if newest == self._given:
            return None
        self._given = newest
        return self.frame(newest)

    def close(self) -> None:
        pass


def texture(seed: int, cells: int, width_px: int, height_px: int) -> Image:
    coarse = np.random.default_rng(seed).integers(40, 200, (cells, cells, 3), np.uint8)
    return np.asarray(cv2.resize(coarse, (width_px, height_px), interpolation=cv2.INTER_CUBIC), np.uint8)


class Slow:
    """The tracker that ships, taking its time on a fake clock."""

    def __init__(self, clock: FakeClock, update_s: float) -> None:
        self._tracker = load_tracker("compact")
        self._clock, self._update_s = clock, update_s
        self.updates = 0

    def init(self, frame_bgr: Image, box: Box) -> None:
        self._tracker.init(frame_bgr, box)

    def update(self, frame_bgr: Image) -> TrackResult:
        self.updates += 1
        self._clock.advance(self._update_s)
        return self._tracker.update(frame_bgr)

    def look_at(self, cx_px: float, cy_px: float) -> None:
        self._tracker.look_at(cx_px, cy_px)


def test_a_selection_made_late_on_a_fast_target_holds_it() -> None:
    clock, update_s = FakeClock(), 0.03
    scene, tracker = Scene(clock), Slow(clock, update_s)
    vision = Vision(scene, tracker, clock, lambda seen: None)
    for _ in range(19):  # 0.6 s of pictures before the operator's box is here
        frame = scene.read()
        assert frame is not None
        newest = vision.step(frame).frame
        clock.advance(1.0 / 30.0)
    drawn = vision.frames.by_seq(0)
    vision.select(scene.truth(0), drawn)
    began_s = clock.now_s()
    seen = vision.step(newest)
    assert seen.result is not None
    assert seen.result.visible
    truth = scene.truth(seen.frame.seq)
    assert abs(seen.result.box.cx_px - truth.cx_px) < SIDE_PX / 4
    assert clock.now_s() - began_s < CATCH_UP_S + 4 * update_s
    assert clock.now_s() - seen.frame.t_arrival_s < 1.0 / 30.0 + 2 * update_s  # it has caught up
    assert seen.track_s == pytest.approx(update_s)  # what came before is no latency of this frame
    assert 10 <= tracker.updates <= 40


def test_without_the_frames_between_the_same_target_is_lost() -> None:
    clock = FakeClock()
    scene, tracker = Scene(clock), Slow(clock, 0.0)
    tracker.init(scene.frame(0).image_bgr, scene.truth(0))
    result = tracker.update(scene.frame(18).image_bgr)
    assert not result.visible or abs(result.box.cx_px - scene.truth(18).cx_px) > SIDE_PX


def test_while_it_catches_up_the_filter_is_not_asked() -> None:
    asked: list[float] = []

    def expect(t_capture_s: float, like: Box) -> Box | None:
        asked.append(t_capture_s)
        return None

    tracker = Tracker()
    tracker.visible = False
    vision = Vision(Source(), tracker, FakeClock(1.0), lambda seen: None, expect)
    for n in range(10):
        vision.step(picture(n))
    number = vision.select(BOX, picture(2))
    seen = vision.step(picture(10))
    assert (seen.frame.seq, seen.selection) == (10, number)
    assert tracker.updated == list(range(3, 11))
    assert asked == []  # the filter still knows the target before
    vision.step(picture(11))
    assert asked == [picture(11).t_capture_s]


def test_frames_that_come_while_it_catches_up_are_not_left_behind() -> None:
    tracker, source = Tracker(), Source(picture(n) for n in (6, 7))
    between: list[Seen] = []
    vision = Vision(source, tracker, FakeClock(1.0), between.append, correction_s=lambda: 0.02)
    for n in range(5):
        vision.step(picture(n))
    vision.select(BOX, picture(3))
    seen = vision.step(picture(5))
    assert seen.frame.seq == 7
    assert seen.frame.t_capture_s == pytest.approx(picture(7).t_capture_s - 0.02)
    assert tracker.updated == [4, 5, 6, 7]
    assert [(each.frame.seq, each.selection, each.result) for each in between] == [(5, 0, None), (6, 0, None)]


def test_a_recorded_video_is_not_read_ahead() -> None:
    tracker, source = Tracker(), Source(picture(n) for n in (6, 7))
    source.is_live = False
    vision = Vision(source, tracker, FakeClock(1.0), lambda seen: None)
    for n in range(5):
        vision.step(picture(n))
    vision.select(BOX, picture(3))
    assert vision.step(picture(5)).frame.seq == 5
    assert tracker.updated == [4, 5]


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

"""A box drawn on a picture that has gone by: tracked forward through the pictures since, and not left behind."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from gcs.clock import FakeClock
from gcs.flight_vision import Seen, Vision
from gcs.video import Frame
from gcs.video.catch_up import CATCH_UP_S
from gcs.video.frame import Image
from tests.gcs.vision_doubles import BOX, Source, Tracker, picture
from tracker.box import Box, TrackResult
from tracker.weights import load_tracker

SIDE_PX = 36


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

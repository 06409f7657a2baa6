"""The box round a point, what moves, and the numbers: in rendered sequences whose truth is known."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

import sitl_mocks.sequences
from gcs import candidates
from gcs.candidates import CandidateFinder, Numbers, box_at
from gcs.candidates_box import iou
from gcs.candidates_motion import moving
from gcs.clock import FakeClock
from gcs.errors import SelectionError
from gcs.selection import check_box
from gcs.video import Frame
from gcs.video.frame import Image
from gcs.video.history import FrameHistory
from tracker.box import Box
from tracker.eval.sequences import read_boxes

DATA = Path(sitl_mocks.sequences.__file__).parent / "data"
FPS = 12.5


def sequence(name: str, count: int) -> Iterator[tuple[Frame, Box]]:
    capture = cv2.VideoCapture(str(DATA / f"{name}.mp4"))
    for seq, row in enumerate(itertools.islice(read_boxes(DATA / f"{name}.txt"), count)):
        ok, image = capture.read()
        assert ok
        yield Frame(seq, np.asarray(image, np.uint8), seq / FPS, seq / FPS), Box.from_xywh(*map(float, row))


def noise(seed: int, height: int = 480, width: int = 640) -> Image:
    """Ground with a pattern to hold on to."""
    rough = np.random.default_rng(seed).normal(120, 25, (height // 8, width // 8, 3)).astype(np.float32)
    return np.asarray(np.clip(cv2.resize(rough, (width, height), interpolation=cv2.INTER_CUBIC), 0, 255), np.uint8)


@pytest.mark.parametrize(("name", "least"), [("car", 0.65), ("walk", 0.37), ("zigzag", 0.65)])
def test_the_box_round_a_point_is_the_things_and_better_than_a_square(name: str, least: float) -> None:
    random = np.random.default_rng(1)
    found, squares = [], []
    for frame, true in [each for each in sequence(name, 110) if each[1].is_valid][::12]:
        x = true.cx_px + random.uniform(-0.2, 0.2) * true.w_px
        y = true.cy_px + random.uniform(-0.2, 0.2) * true.h_px
        found.append(iou(box_at(frame.image_bgr, x, y), true))
        squares.append(iou(Box(x, y, 38.4, 38.4), true))
    assert np.mean(found) > np.mean(squares)
    assert np.mean(found) > least


def test_a_hint_of_its_size_is_taken() -> None:
    image = noise(2)
    cv2.rectangle(image, (280, 200), (360, 280), (20, 20, 230), -1)
    cv2.rectangle(image, (310, 230), (330, 250), (230, 30, 20), -1)
    assert iou(box_at(image, 320, 240, 10), Box(320.5, 240.5, 21, 21)) > 0.7
    assert iou(box_at(image, 320, 240, 40), Box(320.5, 240.5, 81, 81)) > 0.7


@pytest.mark.parametrize("x", [0.0, 3.0, 320.0, 639.9])
@pytest.mark.parametrize("y", [0.0, 240.0, 479.9])
@pytest.mark.parametrize("flat", [True, False])
def test_whatever_is_found_can_be_selected(x: float, y: float, flat: bool) -> None:
    image = np.full((480, 640, 3), 90, np.uint8) if flat else noise(3)
    for radius_px in (None, 0.5, 400.0):
        check_box(box_at(image, x, y, radius_px), 640, 480)


def test_where_nothing_stands_out_it_is_a_square() -> None:
    assert box_at(np.full((480, 640, 3), 90, np.uint8), 320, 240).xywh == pytest.approx((294.4, 214.4, 51.2, 51.2))


@pytest.mark.parametrize("point", [(-1.0, 5.0), (5.0, 480.0), (640.0, 5.0), (float("nan"), 5.0)])
def test_a_point_outside_is_refused(point: tuple[float, float]) -> None:
    with pytest.raises(SelectionError, match="outside the picture"):
        box_at(noise(1), *point)


def shifted(image: Image, right_px: int, thing_x: int, shadow: bool = False) -> Image:
    """The ground as a camera sees it that has turned, with a thing upon it."""
    seen = np.roll(image, -right_px, axis=1)[:, :640].copy()
    if shadow:
        seen[260:310, thing_x : thing_x + 30] //= 2
    seen[200:260, thing_x : thing_x + 30] = (30, 40, 220)
    return seen


@pytest.mark.parametrize("shadow", [False, True])
def test_what_moves_is_found_without_its_shadow_though_the_camera_turns(shadow: bool) -> None:
    ground = noise(4, width=960)
    pictures = [shifted(ground, 12 * i, 200 + 25 * i, shadow) for i in range(3)]
    found = moving([pictures[1], pictures[0]], pictures[2])
    assert iou(found[0].box, Box.from_xywh(250, 200, 30, 60)) > 0.5


def test_nothing_moves_where_only_the_camera_does() -> None:
    ground = noise(5, width=960)
    assert moving([ground[:, 12:652], ground[:, :640]], ground[:, 24:664]) == []


def test_nothing_is_made_of_pictures_that_do_not_belong_together() -> None:
    assert moving([], noise(1)) == []
    assert moving([noise(2, 240, 320)], noise(1)) == []
    assert moving([np.zeros((480, 640, 3), np.uint8)], np.zeros((480, 640, 3), np.uint8)) == []


def test_a_number_is_kept_and_given_again_only_later() -> None:
    numbers = Numbers()
    a, b = Box(100, 100, 40, 40), Box(400, 100, 40, 40)
    numbers.update([a, b], 0.0)
    assert numbers.shown(0.0) == ()  # what is seen once is noise
    numbers.update([Box(395, 100, 40, 42), Box(120, 104, 44, 40)], 0.25)  # in another order, having moved
    assert {each.number: round(each.box.cx_px) for each in numbers.shown(0.25)} == {1: 120, 2: 395}
    for t_s in (0.5, 0.75, 1.0):
        numbers.update([b], t_s)
    assert [each.number for each in numbers.shown(1.0)] == [2]
    c = Box(250, 400, 30, 30)
    numbers.update([b, c], 1.25)
    numbers.update([b, c], 1.5)
    assert [each.number for each in numbers.shown(1.5)] == [2, 3]  # 1 may come back
    numbers.update([Box(120, 104, 44, 40)], 1.75)
    assert 1 in [each.number for each in numbers.shown(1.75)]
    numbers.update([], 20.0)
    numbers.update([c], 20.25)
    numbers.update([c], 20.5)
    assert [each.number for each in numbers.shown(20.5)] == [1]


def test_there_are_never_more_than_nine() -> None:
    numbers = Numbers()
    boxes = [Box(30 + 60 * i, 50, 20, 20) for i in range(15)]
    for t_s in (0.0, 0.25):
        numbers.update(boxes, t_s)
    assert [each.number for each in numbers.shown(0.25)] == list(range(1, 10))


def test_the_target_of_a_sequence_is_among_the_candidates_with_one_number() -> None:
    history = FrameHistory()
    finder = CandidateFinder(history)
    hits, looks, numbers = 0, 0, []
    for frame, true in sequence("zigzag", 70):
        history.add(frame)
        if frame.seq < 12 or frame.seq % 3:
            continue
        finder.look()
        if frame.seq > 18:
            looks += 1
            on = [each for each in finder._found if each.frame is frame and iou(each.box, true) > 0.3]
            hits += bool(on)
            numbers += [each.number for each in on[:1]]
            for each in finder._found:
                check_box(each.box, 640, 480)
    assert hits > 0.7 * looks
    assert len(set(numbers)) <= 2


def test_where_nothing_moves_the_middle_can_be_chosen() -> None:
    history = FrameHistory()
    finder = CandidateFinder(history)
    image = noise(6)
    cv2.rectangle(image, (300, 210), (340, 270), (20, 20, 230), -1)
    for seq in range(10):
        history.add(Frame(seq, image, seq / 4, seq / 4))
        finder.look()
    (only,) = finder._found
    assert iou(only.box, Box(320.5, 240.5, 41, 61)) > 0.7


def test_it_looks_only_while_it_is_asked_and_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(candidates, "_LOOK_S", 0.001)
    clock = FakeClock(10.0)
    looked = threading.Event()

    class History(FrameHistory):
        @property
        def newest(self) -> Frame | None:
            looked.set()
            return None

    finder = CandidateFinder(History(), clock.now_s)
    assert not looked.is_set()
    assert finder._thread is None  # costs nothing
    assert finder.now() == ()
    assert looked.wait(5.0)
    clock.advance(3.0)
    thread = finder._thread
    assert thread is not None
    time.sleep(0.02)  # it finds out at its next look
    looked.clear()
    assert not looked.wait(0.05)
    assert finder.now() == ()
    assert looked.wait(5.0)
    finder.close()
    assert not thread.is_alive()
    finder.now()
    assert finder._thread is thread  # not begun again


def test_it_ends_also_at_the_moment_when_it_goes_to_sleep() -> None:
    asleep_soon, closed = threading.Event(), threading.Event()

    def now_s() -> float:
        if threading.current_thread().name != "candidates":
            return 0.0
        asleep_soon.set()
        closed.wait(5.0)
        return 100.0

    finder = CandidateFinder(FrameHistory(), now_s)
    finder.now()
    looker = next(each for each in threading.enumerate() if each.name == "candidates")
    asleep_soon.wait(5.0)
    closing = threading.Thread(target=finder.close)
    closing.start()
    while not (finder._closed.is_set() and finder._wake.is_set()):
        time.sleep(0.001)
    closed.set()
    closing.join(5.0)
    assert not looker.is_alive()

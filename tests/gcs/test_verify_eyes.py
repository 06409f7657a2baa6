"""Every step of the vision thread again: catching up, hidden targets, failures of the tracker, still video."""

from __future__ import annotations

import itertools
import random
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from control.latency import UNKNOWN
from gcs.config import EngineName, Latent, TrackerConfig
from gcs.flight_vision import Seen, Vision
from gcs.recorder.events import FrameRecord, Selected
from gcs.recorder.manifest import ManifestError, WeightsFacts
from gcs.recorder.message_log import encoder
from gcs.replay.log import FrameRow
from gcs.verify.eyes import DivergedError, EyesAgain
from gcs.verify.verify import as_flown, as_wanted
from gcs.video import Frame
from gcs.video.frame import Image
from gcs.vision_tape import Told
from tracker.box import Box, TrackResult

SIZE = (96, 128, 3)
BOX = Box(60.0, 50.0, 20.0, 16.0)


class Camera:
    """Pictures of noise with a patch that moves; gives a newer one while the tracker catches up, now and then."""

    name, is_live, fps, size, frame_count, problem, ended = "test", True, 20.0, (128, 96), None, None, False

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        self.images: dict[int, Image] = {}
        self.t_s = 100.0
        self.stands = False

    def now_s(self) -> float:
        self.t_s += self.chance.uniform(0.0, 0.004)
        return self.t_s

    def take(self) -> Frame:
        seq = len(self.images)
        image = np.random.default_rng(seq).integers(0, 60, SIZE).astype(np.uint8)
        image[40 + seq % 7 : 60 + seq % 7, 50 + seq % 11 : 70 + seq % 11] += 150
        self.images[seq] = self.images[seq - 1] if self.stands and seq else image
        self.t_s += 0.05
        return Frame(seq, self.images[seq], self.t_s - 0.1, self.t_s, 0.003)

    def read(self, timeout_s: float | None = None) -> Frame | None:
        return self.take() if self.chance.random() < 0.4 else None

    def close(self) -> None:
        """Nothing is open."""


class PatchTracker:
    """Its box drifts with the brightness below it: each bit depends on all before. Fails after 40 pictures."""

    def __init__(self) -> None:
        self.box = BOX
        self.age = 0

    def init(self, frame_bgr: Image, box: Box) -> None:
        if box.w_px < 5:
            raise ValueError("the box is too small")
        self.box, self.age = box, 0

    def update(self, frame_bgr: Image) -> TrackResult:
        self.age += 1
        if self.age == 40:
            raise MemoryError
        bright = float(frame_bgr[int(self.box.cy_px) % 90, int(self.box.cx_px) % 120].mean())
        self.box = replace(self.box, cx_px=self.box.cx_px * 0.99 + bright / 100.0, cy_px=self.box.cy_px * 1.001)
        return TrackResult(self.box, bright / 255.0, 0.5, visible=bright > 80.0)

    def look_at(self, cx_px: float, cy_px: float) -> None:
        self.box = replace(self.box, cx_px=cx_px, cy_px=cy_px)


def record_of(seen: Seen) -> FrameRecord:
    frame = seen.frame
    return FrameRecord(
        frame.t_capture_s, frame.t_arrival_s, seen.t_done_s, seen.selection, seen.result, None, seen.frozen,
        seen.problem, frame.decode_s, seen.track_s, UNKNOWN, seen.repeated, None, None, seen.fingerprint, None,
        seen.told,
    )  # fmt: skip


def film(seed: int) -> tuple[list[tuple[int, FrameRow] | Selected], dict[int, Image]]:
    """What the log of a vision thread holds, and its pictures."""
    camera, events = Camera(seed), []
    chance = random.Random(seed + 1000)
    expect = lambda t_s, like: replace(like, cx_px=30.0 + t_s % 7) if chance.random() < 0.7 else None  # noqa: E731
    row = lambda seen: (seen.frame.seq, read_back(record_of(seen)))  # noqa: E731
    vision = Vision(
        camera, PatchTracker(), camera, lambda seen: events.append(row(seen)), expect, lambda: chance.random() / 50
    )
    for step in range(150):
        camera.stands = 100 < step < 115
        if chance.random() < 0.06:
            old = vision.frames.at(camera.t_s - chance.uniform(0.0, 0.6)) if chance.random() < 0.8 else None
            box = chance.choice([BOX, BOX, replace(BOX, w_px=2.0), None])
            number = vision.select(box, old if box is not None else None)
            events.append(Selected(number, box, old.seq if old is not None and box is not None else None, number))
        events.append(row(vision.step(camera.take())))
    return events, camera.images


def read_back(record: FrameRecord) -> FrameRow:
    return msgspec.json.decode(encoder().encode(record), type=FrameRow)


@pytest.mark.parametrize("seed", range(8))
def test_every_step_is_taken_again_to_the_last_bit(seed: int) -> None:
    events, images = film(seed)
    by_row = {id(event[1]): images[event[0]] for event in events if isinstance(event, tuple)}
    eyes = EyesAgain(PatchTracker(), lambda row: by_row[id(row)])
    again: list[tuple[int, bytes]] = []
    for event in events:
        if isinstance(event, Selected):
            eyes.selected(event)
        else:
            again += [(seen.frame.seq, encoder().encode(record_of(seen))) for seen in eyes.saw(*event)]
    recorded = [(seq, row) for seq, row in (event for event in events if isinstance(event, tuple))]
    assert [seq for seq, _ in again] == [seq for seq, _ in recorded]
    for (seq, made), (_, row) in zip(again, recorded, strict=True):
        assert msgspec.json.decode(made, type=FrameRow) == row, seq


def test_those_films_hold_all_that_can_happen() -> None:
    rows = [event[1] for seed in range(8) for event in film(seed)[0] if isinstance(event, tuple)]
    assert any(row.told is None for row in rows)  # passed by while it caught up
    assert any(row.told is not None and len(row.told.arrivals) > 2 for row in rows)
    assert any(row.told is not None and row.told.expected is not None for row in rows)
    assert any(row.frozen for row in rows)
    assert {row.problem for row in rows} >= {None, "the box is too small", "the tracker failed: MemoryError"}


def test_a_picture_that_is_missing_ends_it() -> None:
    events, images = film(0)
    kept = {id(event[1]): images[event[0]] for event in events[:40] if isinstance(event, tuple)}
    eyes = EyesAgain(PatchTracker(), lambda row: kept.get(id(row)))
    rows = (event for event in events if isinstance(event, tuple))
    with pytest.raises(DivergedError, match="the film does not hold the picture"):
        list(itertools.starmap(eyes.saw, rows))


def test_a_step_of_a_damaged_record_that_names_no_frame_is_told() -> None:
    row = FrameRow(0.0, 0.0, 0.0, told=Told((None,), (1.0,)))
    with pytest.raises(DivergedError, match="names no frame"):
        EyesAgain(PatchTracker(), lambda row: np.zeros(SIZE, np.uint8)).saw(0, row)


def test_the_engine_of_then_tracks_again_and_a_strange_one_is_told() -> None:
    facts = WeightsFacts("compact", "0" * 64, 2, "openvino-int8", "off")
    found = as_flown(TrackerConfig(threads=1), facts)
    assert (found.weights, found.engine, found.threads, found.latent) == (
        "compact", EngineName.OPENVINO, 2, Latent.OFF,
    )  # fmt: skip
    assert as_flown(TrackerConfig(weights="mine", latent=Latent.CLIMNET), facts).weights == "mine"
    with pytest.raises(ManifestError, match="cannot be made again"):
        as_flown(TrackerConfig(), msgspec.structs.replace(facts, engine="abacus"))


def test_what_is_wanted_otherwise_is_not_what_was_flown() -> None:
    facts = WeightsFacts("compact", "0" * 64, 1, "torch", None)
    flown = TrackerConfig()
    assert as_wanted(flown, flown, facts) == as_flown(flown, facts)
    found = as_wanted(replace(flown, engine=EngineName.OPENVINO, threads=4), flown, facts)
    assert (found.weights, found.engine, found.threads) == ("compact", EngineName.OPENVINO, 4)
    found = as_wanted(replace(flown, latent=Latent.OFF), flown, facts)
    assert (found.engine, found.threads, found.latent) == (EngineName.TORCH, 1, Latent.OFF)

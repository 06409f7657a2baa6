from __future__ import annotations

import json
import math
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs.config import Config
from gcs.config import TrackerConfig as TrackerChoice
from gcs.dryrun.batch import Options, run
from gcs.dryrun.output import Summary
from gcs.errors import GcsError, SelectionError, VideoError
from gcs.recorder.message_log import read_messages
from gcs.tracking import BoxTracker
from tests.gcs.clips import Picture, box_at, index_first, picture, write_clip, write_folder, write_truth
from tests.gcs.colour_tracker import ColourTracker
from tests.gcs.mjpeg_server import MjpegServer
from tracker.box import Box, TrackResult
from tracker.eval.sequences import SequenceError

BOX = Box.from_xywh(*box_at(0))


def colour(choice: TrackerChoice) -> BoxTracker:
    return ColourTracker()


def dry_run(
    video: Path | str, out: Path, factory: Callable[[TrackerChoice], BoxTracker] = colour, **options: object
) -> Summary:
    given = {"box": BOX, **options}
    return run(Options(str(video), out, Config(), **given), tracker_factory=factory)  # type: ignore[arg-type]


def frames_of(path: Path) -> int:
    capture, count = cv2.VideoCapture(str(path)), 0
    while capture.read()[0]:
        count += 1
    return count


def test_a_file_leaves_video_messages_boxes_and_summary(tmp_path: Path) -> None:
    clip = write_clip(tmp_path / "a.mp4", frames=40)
    done: list[tuple[int, int | None]] = []
    summary = run(
        Options(str(clip), tmp_path / "out", Config(), box=BOX),
        tracker_factory=colour,
        progress=lambda count, total: done.append((count, total)),
    )
    assert done == [(i, 40) for i in range(1, 41)]
    assert summary.frames == 40
    assert summary.video_s == pytest.approx(39 / 20)
    assert summary.time_lost_s == 0
    assert summary.would_be_setpoints == 40
    assert summary.reasons == {"passed": 40}
    assert summary.problem is None
    assert summary.notes == ()
    assert summary.accuracy is None
    assert frames_of(tmp_path / "out" / "annotated.mp4") == 40
    rows = [[float(v) for v in line.split(",")] for line in (tmp_path / "out" / "boxes.txt").read_text().splitlines()]
    assert len(rows) == 40
    assert rows[30] == pytest.approx(box_at(30), abs=2)
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["frames"] == 40
    records = list(read_messages(tmp_path / "out" / "messages.jsonl"))
    counts = {kind: sum(r.type == kind for r in records) for kind in ("Tracked", "View", "Tick")}
    assert counts == {"Tracked": 40, "View": 40, "Tick": 40}
    assert [r.frame for r in records if r.type == "Tracked"] == list(range(40))
    assert [r.n for r in records] == list(range(len(records)))


def test_two_runs_ask_for_the_same_bit_for_bit(tmp_path: Path) -> None:
    clip = write_clip(tmp_path / "a.mp4", frames=30)
    ticks = []
    for name in ("one", "two"):
        dry_run(clip, tmp_path / name)
        ticks.append([r.data for r in read_messages(tmp_path / name / "messages.jsonl") if r.type == "Tick"])
    assert ticks[0] == ticks[1]
    assert any(tick["would_be"] for tick in ticks[0])


def test_an_image_folder_scored_against_ground_truth(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "images", frames=30)
    truth = write_truth(tmp_path / "gt.txt", 30)
    summary = dry_run(folder, tmp_path / "out", box=None, truth=truth)
    assert summary.first_box_xywh == box_at(0)
    assert summary.accuracy is not None
    assert summary.accuracy.auc_valid > 0.95
    assert summary.accuracy.precision_valid == 1.0
    elsewhere = dry_run(folder, tmp_path / "out", factory=lambda choice: Blind(), box=None, truth=truth)
    assert elsewhere.accuracy is not None
    assert elsewhere.accuracy.auc_valid == pytest.approx(10 / 30, abs=0.05)


class Blind(ColourTracker):
    """Loses the target after ten frames, and says so."""

    def __init__(self) -> None:
        super().__init__()
        self._frames = 0

    def update(self, frame_bgr: Picture) -> TrackResult:
        self._frames += 1
        if self._frames < 10:
            return super().update(frame_bgr)
        return TrackResult(Box(300.0, 20.0, 12.0, 12.0), 0.0, 0.0)


def test_time_without_the_target_is_counted_and_ends_in_zero(tmp_path: Path) -> None:
    clip = write_clip(tmp_path / "a.mp4", frames=80)
    summary = dry_run(clip, tmp_path / "out", factory=lambda choice: Blind())
    assert 3.0 < summary.time_lost_s < 3.6
    ticks = [r.data for r in read_messages(tmp_path / "out" / "messages.jsonl") if r.type == "Tick"]
    asked = [math.hypot(*t["would_be"]["velocity_ned_mps"]) for t in ticks if t["would_be"] and t["t_s"] > 1.6]
    assert asked
    assert max(asked) == 0


class Broken(ColourTracker):
    """Gives what no tracker should."""

    def update(self, frame_bgr: Picture) -> TrackResult:
        return TrackResult(Box(math.nan, 1.0, 2.0, 3.0), math.inf, 0.9)


def test_a_box_that_is_not_a_number_moves_nothing(tmp_path: Path) -> None:
    summary = dry_run(write_clip(tmp_path / "a.mp4", frames=60), tmp_path / "out", factory=lambda choice: Broken())
    ticks = [r.data for r in read_messages(tmp_path / "out" / "messages.jsonl") if r.type == "Tick"]
    assert summary.time_lost_s > 2.0
    assert all(t["would_be"] is None or not any(t["would_be"]["velocity_ned_mps"]) for t in ticks if t["t_s"] > 1.2)


def test_a_truncated_video_is_run_as_far_as_it_goes_and_named(tmp_path: Path) -> None:
    whole = index_first(write_clip(tmp_path / "a.mp4", frames=60))
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(whole.read_bytes()[: int(whole.stat().st_size * 0.5)])
    truth = write_truth(tmp_path / "gt.txt", 60)
    summary = dry_run(cut, tmp_path / "out", truth=truth)
    assert 5 < summary.frames < 58
    assert summary.problem is not None
    assert f"only {summary.frames} of 60 frames" in summary.problem
    assert frames_of(tmp_path / "out" / "annotated.mp4") == summary.frames
    assert summary.accuracy is not None


def test_the_limit_ends_it_early(tmp_path: Path) -> None:
    summary = dry_run(write_clip(tmp_path / "a.mp4", frames=40), tmp_path / "out", limit_s=0.5, annotate=False)
    assert summary.frames == 11
    assert not (tmp_path / "out" / "annotated.mp4").exists()


def test_an_interrupted_run_still_leaves_its_results(tmp_path: Path) -> None:
    class Interrupted(ColourTracker):
        def update(self, frame_bgr: Picture) -> TrackResult:
            raise KeyboardInterrupt

    summary = dry_run(write_clip(tmp_path / "a.mp4"), tmp_path / "out", factory=lambda choice: Interrupted())
    assert summary.interrupted
    assert summary.frames == 1
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["interrupted"] is True


def test_a_live_stream_runs_until_it_ends(tmp_path: Path) -> None:
    server = MjpegServer()
    seen = threading.Event()

    class Signalling(ColourTracker):
        def init(self, frame_bgr: Picture, box: Box) -> None:
            super().init(frame_bgr, box)
            seen.set()

        def update(self, frame_bgr: Picture) -> TrackResult:
            seen.set()
            return super().update(frame_bgr)

    def feed() -> None:
        for index in range(3):
            assert seen.wait(5.0)  # the newest wins: the next must not come before this one was taken
            seen.clear()
            server.send(picture(index + 1))
        assert seen.wait(5.0)
        server.drop()

    server.send(picture(0))
    feeder = threading.Thread(target=feed)
    feeder.start()
    summary = dry_run(server.url, tmp_path / "out", factory=lambda choice: Signalling())
    feeder.join()
    server.close()
    assert summary.frames == 4
    assert summary.problem is None


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"box": Box.from_xywh(300, 10, 60, 60)}, "outside the frame of 320x240"),
        ({"box": Box.from_xywh(30, 10, 6, 60)}, "under 10 px"),
        ({"box": None}, "nothing to track"),
        ({"box": None, "select": True}, "needs a display"),
    ],
)
def test_a_box_that_will_not_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: dict[str, object], why: str
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    with pytest.raises(SelectionError, match=why):
        dry_run(write_clip(tmp_path / "a.mp4"), tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_absent_at_the_start_and_other_bad_ground_truth(tmp_path: Path) -> None:
    clip = write_clip(tmp_path / "a.mp4")
    truth = tmp_path / "gt.txt"
    truth.write_text("NaN,NaN,NaN,NaN\n" * 20)
    with pytest.raises(SelectionError, match="absent in the first frame"):
        dry_run(clip, tmp_path / "out", box=None, truth=truth)
    truth.write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(SequenceError, match="not a text file"):
        dry_run(clip, tmp_path / "out", box=None, truth=truth)


def test_what_the_tracker_refuses_is_one_line(tmp_path: Path) -> None:
    class Refusing(ColourTracker):
        def init(self, frame_bgr: Picture, box: Box) -> None:
            raise ValueError("box: too small")

    with pytest.raises(SelectionError, match="too small"):
        dry_run(write_clip(tmp_path / "a.mp4"), tmp_path / "out", factory=lambda choice: Refusing())


def test_no_video_and_no_folder(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match="no such file"):
        dry_run(tmp_path / "none.mp4", tmp_path / "out")
    (tmp_path / "file").write_text("")
    with pytest.raises(GcsError, match="--out"):
        dry_run(write_clip(tmp_path / "a.mp4"), tmp_path / "file" / "out")


def test_a_folder_with_a_recorded_flight_is_left_alone(tmp_path: Path) -> None:
    out = tmp_path / "flight"
    out.mkdir()
    (out / "manifest.json").write_text("{}")
    (out / "messages.jsonl").write_text("flown")
    with pytest.raises(GcsError, match=r"flight: holds a recorded flight; give another folder$"):
        dry_run(write_clip(tmp_path / "a.mp4"), out)
    assert (out / "messages.jsonl").read_text() == "flown"


def test_nothing_of_an_earlier_run_is_taken_for_this_ones(tmp_path: Path) -> None:
    clip, out = write_clip(tmp_path / "a.mp4"), tmp_path / "out"
    dry_run(clip, out)
    assert (out / "annotated.mp4").exists()
    dry_run(clip, out, annotate=False)
    assert not (out / "annotated.mp4").exists()
    assert (out / "boxes.txt").exists()


def test_the_camera_of_the_configuration_must_fit_the_video(tmp_path: Path) -> None:
    config = Config()
    camera = replace(config.camera, width_px=1280, height_px=720, fx_px=900.0)
    options = Options(str(write_clip(tmp_path / "a.mp4")), tmp_path / "out", replace(config, camera=camera), box=BOX)
    with pytest.raises(GcsError, match="calibrated at 1280x720 px"):
        run(options, tracker_factory=colour)


def test_a_full_disk_leaves_notes_and_the_run_goes_on(tmp_path: Path) -> None:
    config = Config()
    small = replace(config, recorder=replace(config.recorder, size_limit_mb=0.002))
    out = tmp_path / "out"
    (out / "annotated.mp4").mkdir(parents=True)
    summary = run(Options(str(write_clip(tmp_path / "a.mp4")), out, small, box=BOX), tracker_factory=colour)
    assert summary.frames == 20
    assert len(summary.notes) == 2
    assert any("size limit" in note for note in summary.notes)
    assert any("annotated.mp4: cannot be written" in note for note in summary.notes)


def test_odd_picture_sizes_are_written_whole(tmp_path: Path) -> None:
    folder = tmp_path / "odd"
    folder.mkdir()
    for index in range(3):
        cv2.imwrite(str(folder / f"{index}.png"), np.ascontiguousarray(picture(index)[:, :319]))
    summary = dry_run(folder, tmp_path / "out")
    assert summary.notes == ()
    assert frames_of(tmp_path / "out" / "annotated.mp4") == 3

"""The dry run: a recorded or live video through the whole chain of a flight, and nothing to send it to.

No wire is built or imported: recorded video can never arm or move anything.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from control.camera import CameraModel
from gcs.config import Config
from gcs.config import TrackerConfig as TrackerChoice
from gcs.dryrun.output import (
    ANNOTATED,
    AnnotatedVideo,
    Summary,
    Tally,
    Truth,
    accuracy_of,
    prepare_folder,
    remove_earlier,
    write_results,
)
from gcs.dryrun.rehearsal import ASSUMED_DISTANCE_M, Pose, Rehearsal, Tick, View
from gcs.dryrun.view import overlay_of
from gcs.errors import SelectionError, VideoError
from gcs.hud import Overlay, draw
from gcs.poses import RecordedPoses
from gcs.recorder.message_log import MessageLog
from gcs.selection import check_box, draw_box
from gcs.tracking import BoxTracker, make_tracker
from gcs.video import Frame, VideoSource, open_source
from tracker.box import Box, TrackResult
from tracker.eval.sequences import read_boxes

SILENCE_S = 5.0
LIVE_FPS = 20.0
MIN_TRUTH_SIDE_PX = 4.0


@dataclass(frozen=True, slots=True)
class Options:
    """What to run dry. box, else the first row of `truth`, else `select` (draw it in a window).

    camera: overrides the configuration's lens. limit_s: stop after this much video time.
    """

    video: str
    out: Path
    config: Config
    box: Box | None = None
    truth: Path | None = None
    telemetry: Path | None = None
    camera: CameraModel | None = None
    select: bool = False
    limit_s: float | None = None
    annotate: bool = True


@dataclass(frozen=True, slots=True)
class Tracked:
    """Log record of one frame. Times: as in gcs.video.Frame; box x, y, w, h in px."""

    t_capture_s: float
    t_arrival_s: float
    box_xywh: tuple[float, float, float, float]
    score: float | None
    confidence: float
    track_s: float


Progress = Callable[[int, int | None], None]


def run(
    options: Options,
    *,
    tracker_factory: Callable[[TrackerChoice], BoxTracker] = make_tracker,
    progress: Progress = lambda done, total: None,
) -> Summary:
    """Run to the end of the video, the limit, or Ctrl-C; results are in options.out.

    A video that breaks on the way gives a Summary with `problem`. Raises GcsError or a ValueError of the
    tracker, one line each, when there is nothing to run.
    """
    poses = RecordedPoses.load(options.telemetry) if options.telemetry else None
    truth = read_boxes(options.truth) if options.truth else None
    source = open_source(
        options.video,
        glass_delay_s=options.config.camera.assumed_glass_delay_s,
        fps=options.config.video.fps,
        reconnect=False,
    )
    try:
        camera = options.camera or options.config.camera.model(*source.size)
        # A stream goes on while the network loads: load it first. A file waits, and its faults show at once.
        tracker = tracker_factory(options.config.tracker) if source.is_live else None
        first = source.read(SILENCE_S)
        if first is None:
            raise VideoError(source.problem or f"{source.name}: no frame within {SILENCE_S:.0f} s")
        box = first_box(options, truth, source.size, first)
        tracker = tracker or tracker_factory(options.config.tracker)
        _start(tracker, first, box)
        dry_run = _DryRun(options, source, tracker, camera, poses)
        return dry_run.run(first, box, truth, progress)
    finally:
        source.close()


class _DryRun:
    """One run's parts and counts."""

    def __init__(
        self,
        options: Options,
        source: VideoSource,
        tracker: BoxTracker,
        camera: CameraModel,
        poses: RecordedPoses | None,
    ) -> None:
        self._options = options
        self._source = source
        self._tracker = tracker
        self._poses = poses
        self._rehearsal = Rehearsal(camera, options.config)
        self._tally = Tally()
        self._out = prepare_folder(options.out)
        remove_earlier(self._out)
        self._video = None
        if options.annotate:
            path = self._out / ANNOTATED
            self._video = AnnotatedVideo(path, source.size, source.fps or LIVE_FPS)
        limit_bytes = int(options.config.recorder.size_limit_mb * 1e6)
        self._log = MessageLog(self._out / "messages.jsonl", wait_when_full=True, size_limit_bytes=limit_bytes)
        self._last_tick: Tick | None = None
        self._t0_s = 0.0
        self._t_s = 0.0
        self._frames = 0
        self._start_s = time.perf_counter()

    def run(self, first: Frame, box: Box, truth: Truth | None, progress: Progress) -> Summary:
        self._t0_s = first.t_capture_s
        problem, interrupted = None, False
        try:
            # By the convention of one-pass evaluation the first frame's result is the given box.
            self._take(first, TrackResult(box, math.nan, 1.0), 0.0)
            progress(1, self._source.frame_count)
            problem = self._loop(progress)
        except KeyboardInterrupt:
            interrupted = not self._source.is_live
        finally:
            self._close()
        summary = replace(self._summary(box, truth, problem), interrupted=interrupted)
        write_results(self._out, summary, self._tally.boxes_xywh)
        return summary

    def _loop(self, progress: Progress) -> str | None:
        """Frame after frame; returns what was wrong with the video, if anything."""
        limit_s = self._options.limit_s
        while (frame := self._source.read(SILENCE_S)) is not None:
            if limit_s is not None and frame.t_capture_s - self._t0_s > limit_s:
                return None
            started_s = time.perf_counter()
            result = self._tracker.update(frame.image_bgr)
            self._take(frame, result, time.perf_counter() - started_s)
            progress(self._frames, self._source.frame_count)
        if not self._source.ended:
            return f"{self._source.name}: silent for {SILENCE_S:.0f} s"
        return self._source.problem

    def _take(self, frame: Frame, result: TrackResult, track_s: float) -> None:
        """Everything that follows from one frame's result."""
        self._t_s = t_s = frame.t_capture_s - self._t0_s
        self._frames += 1
        self._tick_until(t_s)
        pose = self._poses.at(t_s) if self._poses else Pose()
        view = self._rehearsal.observe(t_s, result, pose) if result.box.is_valid else None
        self._count(result, track_s)
        tracked = Tracked(
            t_s,
            frame.t_arrival_s - self._t0_s,
            result.box.xywh,
            result.score if math.isfinite(result.score) else None,
            result.confidence,
            track_s,
        )
        self._log.write(t_s, tracked, frame.seq)
        if view is not None:
            self._log.write(t_s, view, frame.seq)
        if self._video is not None:
            self._video.write(draw(frame.image_bgr, self._overlay(result, view, track_s)), t_s)

    def _tick_until(self, t_s: float) -> None:
        for tick in self._rehearsal.advance(t_s):
            self._tally.add_tick(tick)
            self._log.write(tick.t_s, tick)
            self._last_tick = tick

    def _count(self, result: TrackResult, track_s: float) -> None:
        self._tally.boxes_xywh.append(result.box.xywh)
        self._tally.confidences.append(result.confidence)
        if self._frames > 1:
            self._tally.track_s.append(track_s)

    def _overlay(self, result: TrackResult, view: View | None, track_s: float) -> Overlay:
        total = self._source.frame_count
        count = f"frame {self._frames}" + (f"/{total}" if total else "")
        return overlay_of(result, view, self._last_tick, f"{count}   tracker {track_s * 1e3:.0f} ms")

    def _close(self) -> None:
        self._tick_until(self._t_s + 1.0 / (self._source.fps or LIVE_FPS))
        self._log.close()
        if self._video is not None:
            self._video.close()

    def _summary(self, box: Box, truth: Truth | None, problem: str | None) -> Summary:
        notes = [note for note in (self._log.problem, self._video.problem if self._video else None) if note]
        return self._tally.summary(
            video=self._source.name,
            frames=self._frames,
            video_s=self._t_s,
            wall_s=time.perf_counter() - self._start_s,
            assumed_distance_m=ASSUMED_DISTANCE_M if self._rehearsal.distance_was_assumed else None,
            first_box_xywh=box.xywh,
            accuracy=accuracy_of(self._tally.boxes_xywh, truth),
            out=self._out,
            problem=problem,
            notes=tuple(notes),
        )


def _start(tracker: BoxTracker, first: Frame, box: Box) -> None:
    try:
        tracker.init(first.image_bgr, box)
    except ValueError as error:
        raise SelectionError(str(error)) from error


def first_box(options: Options, truth: Truth | None, size: tuple[int, int], first: Frame | None = None) -> Box:
    """What to track from the first frame (None: nothing can be drawn on it). Raises SelectionError."""
    if options.select and first is not None:
        return check_box(draw_box(first.image_bgr), *size)
    if options.box is not None:
        return check_box(options.box, *size)
    if truth is not None:
        if not np.isfinite(truth[0]).all():
            raise SelectionError(f"{options.truth}: the target is absent in the first frame; give --box x,y,w,h")
        return check_box(Box.from_xywh(*(float(v) for v in truth[0])), *size, MIN_TRUTH_SIDE_PX)
    raise SelectionError("nothing to track: give --box x,y,w,h, --select, or --boxes with ground truth")

"""What a dry run with a page leaves behind: the files of a batch run, and the messages of a flight."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from gcs.audit import Audit
from gcs.config import RecorderConfig
from gcs.dryrun.output import ANNOTATED, Summary, Tally, prepare_folder, remove_earlier, write_results
from gcs.dryrun.pace import FilmFrame
from gcs.dryrun.rehearsal import ASSUMED_DISTANCE_M, WouldBe
from gcs.dryrun.rehearsal import Tick as Rehearsed
from gcs.flight_video import FlightVideo
from gcs.flight_view import Sighting, overlay
from gcs.recorder.flight_recorder import FlightRecorder
from gcs.tick import Tick

_NOT_SEEN = (math.nan, math.nan, math.nan, math.nan)


class DryRunRecord:
    """One pass through the video, a `Watcher`; the files of the pass before are overwritten.

    annotate: whether a film is made at all. Boxes of frames without a target, or skipped, are NaN.
    """

    def __init__(
        self,
        out: Path,
        config: RecorderConfig,
        size: tuple[int, int],
        fps: float,
        *,
        video: str,
        annotate: bool,
        assumed: Callable[[], bool],
    ) -> None:
        """assumed: whether the distance confirmed is one that nothing tells. GcsError without a folder."""
        self._out, self._name = prepare_folder(out), video
        remove_earlier(out)
        self._messages = FlightRecorder(out, config)
        self._film = FlightVideo(out / ANNOTATED, size, fps) if annotate else None
        self._tally = Tally()
        self._boxes: dict[int, tuple[float, float, float, float]] = {}
        self._frames, self._first_s, self._last_s = 0, math.nan, 0.0
        self._start_s = time.perf_counter()
        self._assumed = assumed
        self._assumed_distance_m: float | None = None

    def saw(self, sighting: Sighting) -> None:
        """A frame; of recorded video by its number there."""
        seen = sighting.seen
        frame = seen.frame
        if math.isnan(self._first_s):
            self._first_s = frame.t_arrival_s
        self._last_s = frame.t_arrival_s
        index = frame.index if isinstance(frame, FilmFrame) else self._frames
        self._frames += 1
        if seen.result is not None:
            self._boxes[index] = seen.result.box.xywh
            self._tally.confidences.append(seen.result.confidence)
            self._tally.track_s.append(seen.track_s)
        else:
            self._boxes.setdefault(index, _NOT_SEEN)
        self._messages.saw(sighting)
        if self._film is not None and sighting.status.recording:
            drawn = overlay(sighting, "DRY RUN")
            lines = (*drawn.lines, sighting.status.link)
            self._film.write(frame.image_bgr, replace(drawn, lines=lines), frame.t_arrival_s)

    def ticked(self, tick: Tick) -> None:
        """A decision."""
        self._messages.ticked(tick)
        if tick.held is None:
            return  # whoever stopped it has not lost anything
        if self._assumed():
            self._assumed_distance_m = ASSUMED_DISTANCE_M
        setpoint = tick.setpoint
        would_be = None
        if setpoint is not None:
            would_be = WouldBe(tick.t_s, setpoint.velocity_ned_mps, setpoint.yaw_rate_rps, tick.gate)
        output = tick.output
        self._tally.add_tick(Rehearsed(tick.t_s, output.state, output.reasons, tick.target, tick.request, would_be))

    def audited(self, t_s: float, audit: Audit) -> None:
        """There is no vehicle to audit."""

    def finish(self, problem: str | None) -> Summary:
        """Close the files and write boxes.txt and summary.json; takes up to some seconds."""
        notes = self._messages.close()
        if self._film is not None:
            self._film.close()
            notes += [self._film.problem] if self._film.problem is not None else []
        summary = self._summary(problem, tuple(notes))
        rows = [self._boxes.get(index, _NOT_SEEN) for index in range(max(self._boxes, default=-1) + 1)]
        write_results(self._out, summary, rows)
        return summary

    def _summary(self, problem: str | None, notes: tuple[str, ...]) -> Summary:
        first = next((box for _, box in sorted(self._boxes.items()) if not math.isnan(box[0])), _NOT_SEEN)
        return self._tally.summary(
            video=self._name,
            frames=self._frames,
            video_s=self._last_s - self._first_s if self._frames else 0.0,
            wall_s=time.perf_counter() - self._start_s,
            assumed_distance_m=self._assumed_distance_m,
            first_box_xywh=first,
            out=self._out,
            problem=problem,
            notes=notes,
        )

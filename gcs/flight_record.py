"""What a flight leaves behind: messages.jsonl, flight.mp4, flight.tlog; none of it can hold the flight up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from control.latency import DelayEstimate
from control.types import BearingMeasurement
from gcs.audit import Audit
from gcs.config import RecorderConfig
from gcs.flight_control import Tick
from gcs.flight_video import FlightVideo
from gcs.flight_view import Sighting, overlay
from gcs.link_meters import LinkFigures
from gcs.messages import MessageLog
from tracker.box import TrackResult

_FPS: Final = 20.0
_FIGURES_S: Final = 1.0
MESSAGES, VIDEO, TLOG = "messages.jsonl", "flight.mp4", "flight.tlog"


@dataclass(frozen=True, slots=True)
class FrameRecord:
    """One frame in the log: its times, what the tracker said of it and the line of sight that became of it."""

    t_capture_s: float
    t_arrival_s: float
    t_done_s: float
    selection: int
    result: TrackResult | None
    measurement: BearingMeasurement | None
    frozen: bool
    problem: str | None
    decode_s: float
    track_s: float
    glass_delay: DelayEstimate  # what the pictures tell; what is used is the difference of the first two times


@dataclass(slots=True)
class Film:
    """The operator's switch for the film of a flight; what was not filmed stands still in it."""

    on: bool = True


class FlightRecorder:
    """A `Watcher` that writes; close it after the flight."""

    def __init__(
        self,
        folder: Path,
        config: RecorderConfig,
        size: tuple[int, int],
        fps: float | None,
        watermark: str | None = None,
        figures: Callable[[float], LinkFigures] | None = None,
    ) -> None:
        """folder must exist; size (width, height) in px and fps are those of the video source.

        figures: asked once a second for the link's.
        """
        self._figures = figures
        self._figures_due_s = 0.0
        self._watermark = watermark
        limit = int(config.size_limit_mb * 1e6)
        self._messages = MessageLog(folder / MESSAGES, size_limit_bytes=limit) if config.messages else None
        self._video = FlightVideo(folder / VIDEO, size, fps or _FPS) if config.video else None
        self.film = Film() if config.video else None

    def saw(self, sighting: Sighting) -> None:
        """Log the frame and draw it."""
        seen = sighting.seen
        frame = seen.frame
        if self._messages is not None:
            record = FrameRecord(
                frame.t_capture_s, frame.t_arrival_s, seen.t_done_s, seen.selection, seen.result,
                sighting.measurement, seen.frozen, seen.problem, frame.decode_s, seen.track_s,
                sighting.status.glass_delay,
            )  # fmt: skip
            self._messages.write(seen.t_done_s, record, frame.seq)
        if self._video is not None and self.film is not None and self.film.on:
            self._video.write(frame.image_bgr, overlay(sighting, self._watermark), frame.t_arrival_s)

    def ticked(self, tick: Tick) -> None:
        """Log the decision."""
        if self._messages is not None:
            self._messages.write(tick.t_s, tick)
        if self._messages is not None and self._figures is not None and tick.t_s >= self._figures_due_s:
            self._figures_due_s = tick.t_s + _FIGURES_S
            self._messages.write(tick.t_s, self._figures(tick.t_s))

    def audited(self, t_s: float, audit: Audit) -> None:
        """Log the vehicle's parameters."""
        if self._messages is not None:
            self._messages.write(t_s, audit)

    def close(self) -> list[str]:
        """Finish the files; what went wrong with them, in one line each."""
        problems = []
        for part in (self._messages, self._video):
            if part is None:
                continue
            part.close()
            if part.problem is not None:
                problems.append(part.problem)
            elif part.dropped:
                problems.append(f"{part.dropped} records were dropped: the disk or the processor was too slow")
        return problems

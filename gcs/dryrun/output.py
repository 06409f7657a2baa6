"""What a dry run leaves behind: annotated.mp4, messages.jsonl, boxes.txt, summary.json."""

from __future__ import annotations

import contextlib
import math
import statistics
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from control.engagement import State
from control.gate_limits import TICK_S
from gcs.dryrun.rehearsal import Tick
from gcs.errors import GcsError
from gcs.recorder.manifest import MANIFEST
from gcs.video.frame import Image
from tracker.eval.ope import score

Truth = NDArray[np.float64]  # (N, 4) x, y, w, h px; NaN = absent

ANNOTATED = "annotated.mp4"
MAX_REPEATS = 100


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Against ground truth, as tracker.eval.ope scores it; `_valid`: frames with a target in them only."""

    auc: float
    precision: float
    auc_valid: float
    precision_valid: float


@dataclass(frozen=True, slots=True)
class Summary:
    """The outcome of a dry run.

    fps: frames per second of wall time, everything included. track_ms_*: the tracker alone. time_lost_s: video
    time during which the target was not seen once followed. would_be_setpoints: what would have gone out at
    20 Hz, by the gate's reason. assumed_distance_m: set where neither height nor view angle could tell it.
    """

    video: str
    frames: int
    video_s: float
    wall_s: float
    fps: float
    track_ms_median: float
    track_ms_p95: float
    time_lost_s: float
    would_be_setpoints: int
    reasons: dict[str, int]
    max_speed_mps: float
    max_yaw_rate_rps: float
    mean_confidence: float
    assumed_distance_m: float | None
    first_box_xywh: tuple[float, float, float, float]
    accuracy: Accuracy | None
    out: str
    problem: str | None = None
    interrupted: bool = False  # a recorded video not run to its end; a live one has no other end
    notes: tuple[str, ...] = ()

    def line(self) -> str:
        """For the terminal."""
        parts = [
            f"{self.frames} frames at {self.fps:.1f} fps",
            f"time lost {self.time_lost_s:.1f} of {self.video_s:.1f} s",
            f"{self.would_be_setpoints} would-be setpoints (up to {self.max_speed_mps:.1f} m/s, "
            f"{math.degrees(self.max_yaw_rate_rps):.0f} deg/s)",
        ]
        if self.accuracy is not None:
            parts.append(f"success {self.accuracy.auc_valid:.3f}, precision {self.accuracy.precision_valid:.3f}")
        return f"dry run: {'; '.join(parts)}; see {self.out}"


@dataclass(slots=True)
class Tally:
    """Counts while the run goes on."""

    track_s: list[float] = field(default_factory=list)
    confidences: list[float] = field(default_factory=list)
    boxes_xywh: list[tuple[float, float, float, float]] = field(default_factory=list)
    reasons: Counter[str] = field(default_factory=Counter)
    unseen_ticks: int = 0
    max_speed_mps: float = 0.0
    max_yaw_rate_rps: float = 0.0
    _engaged: bool = False

    def add_tick(self, tick: Tick) -> None:
        """Count one 20 Hz moment."""
        self._engaged = self._engaged or tick.state is State.FOLLOWING
        # After a release the imagined operator waits for the target, in whatever state: lost until followed.
        self.unseen_ticks += self._engaged and tick.state is not State.FOLLOWING
        if tick.would_be is not None:
            self.reasons[tick.would_be.reason.name.lower()] += 1
            self.max_speed_mps = max(self.max_speed_mps, math.hypot(*tick.would_be.velocity_ned_mps))
            self.max_yaw_rate_rps = max(self.max_yaw_rate_rps, abs(tick.would_be.yaw_rate_rps))

    @property
    def time_lost_s(self) -> float:
        return self.unseen_ticks * TICK_S

    def track_ms(self) -> tuple[float, float]:
        """(median, 95th percentile) of the tracker's time per frame."""
        if not self.track_s:
            return 0.0, 0.0
        ordered = sorted(self.track_s)
        return statistics.median(ordered) * 1e3, ordered[min(len(ordered) - 1, int(0.95 * len(ordered)))] * 1e3

    def summary(
        self,
        *,
        video: str,
        frames: int,
        video_s: float,
        wall_s: float,
        assumed_distance_m: float | None,
        first_box_xywh: tuple[float, float, float, float],
        out: Path,
        problem: str | None,
        notes: tuple[str, ...],
        accuracy: Accuracy | None = None,
    ) -> Summary:
        """With what was counted here."""
        median_ms, p95_ms = self.track_ms()
        return Summary(
            video=video,
            frames=frames,
            video_s=video_s,
            wall_s=wall_s,
            fps=frames / wall_s,
            track_ms_median=median_ms,
            track_ms_p95=p95_ms,
            time_lost_s=self.time_lost_s,
            would_be_setpoints=sum(self.reasons.values()),
            reasons=dict(self.reasons),
            max_speed_mps=self.max_speed_mps,
            max_yaw_rate_rps=self.max_yaw_rate_rps,
            mean_confidence=sum(self.confidences) / max(len(self.confidences), 1),
            assumed_distance_m=assumed_distance_m,
            first_box_xywh=first_box_xywh,
            accuracy=accuracy,
            out=str(out),
            problem=problem,
            notes=notes,
        )


class AnnotatedVideo:
    """An mp4 on the frames' own time: a pause repeats a picture. A disk fault ends it, never the run."""

    def __init__(self, path: Path, size: tuple[int, int], fps: float) -> None:
        self.path = path
        self.problem: str | None = None
        self._fps = fps
        self._written = 0
        self._writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), fps, size)
        if not self._writer.isOpened():
            self.problem = f"{path}: cannot be written"

    def write(self, image_bgr: Image, t_s: float) -> None:
        """Add one picture at t_s, counted from the first."""
        if self.problem is not None:
            return
        due = round(t_s * self._fps) + 1
        try:
            for _ in range(min(max(due - self._written, 0), MAX_REPEATS)):
                self._writer.write(image_bgr)
        except cv2.error as error:
            self.problem = f"{self.path}: {error.err}"
        self._written = max(due, self._written)

    def close(self) -> None:
        """Finish the file; only then can it be played."""
        self._writer.release()
        if self.problem is None and not (self.path.exists() and self.path.stat().st_size > 0):
            self.problem = f"{self.path}: nothing could be written"


def prepare_folder(folder: Path) -> Path:
    """Make the output folder. Raises GcsError where that cannot be, or where a flight is recorded in it."""
    if (folder / MANIFEST).exists():
        raise GcsError(f"--out {folder}: holds a recorded flight; give another folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise GcsError(f"--out {folder}: {(error.strerror or str(error)).lower()}") from error
    return folder


def remove_earlier(folder: Path) -> None:
    """What a dry run left there before: not all of it may be written again."""
    for name in (ANNOTATED, "messages.jsonl", "boxes.txt", "summary.json"):
        with contextlib.suppress(OSError):  # whoever writes it says so
            (folder / name).unlink()


def write_results(folder: Path, summary: Summary, boxes_xywh: list[tuple[float, float, float, float]]) -> None:
    """boxes.txt (x,y,w,h per frame, px) and summary.json. Raises GcsError where they cannot be written."""
    text = "".join("{:.2f},{:.2f},{:.2f},{:.2f}\n".format(*box) for box in boxes_xywh)
    try:
        (folder / "boxes.txt").write_text(text)
        (folder / "summary.json").write_bytes(msgspec.json.format(msgspec.json.encode(summary), indent=2) + b"\n")
    except OSError as error:
        raise GcsError(f"--out {folder}: {(error.strerror or str(error)).lower()}") from error


def accuracy_of(
    boxes_xywh: list[tuple[float, float, float, float]],
    truth: Truth | None,
) -> Accuracy | None:
    """Over the frames that both have: a limit or a truncated video leaves truth over."""
    if truth is None:
        return None
    count = min(len(boxes_xywh), len(truth))
    found = score(np.array(boxes_xywh[:count]), truth[:count])
    return Accuracy(found.auc, found.precision, found.auc_valid, found.precision_valid)

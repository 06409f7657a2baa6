"""A flight judged by the simulator's ground truth: what was flown, not what our own estimate says."""

from __future__ import annotations

import json
import math
from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from control.types import Vec3
from gcs.errors import GcsError
from gcs.truth import Standing, is_on
from tracker.box import Box

_MIN_VISIBLE_FRAC = 0.3
_JOIN_S = 0.05  # a frame belongs to the truth of this long before or after


@dataclass(frozen=True, slots=True)
class TruthRow(Standing):
    """One rendered frame: capture time (monotonic s), NED metres, the camera's yaw in rad, box x, y, w, h in px."""

    t_s: float
    vehicle_ned_m: Vec3
    yaw_rad: float
    target_ned_m: Vec3
    box_xywh_px: tuple[float, float, float, float] | None
    visible_frac: float

    @property
    def is_visible(self) -> bool:
        """Enough of the target is in the picture and uncovered."""
        return self.box_xywh_px is not None and self.visible_frac >= _MIN_VISIBLE_FRAC


@dataclass(frozen=True, slots=True)
class TrackedFrame:
    """What the tracker said of one frame of the follow: box None = it saw nothing to trust."""

    t_capture_s: float
    box: Box | None


@dataclass(frozen=True, slots=True)
class Span:
    """From one confirmation to the next or the end, lost or not, and the ground distance it was to hold."""

    start_s: float
    end_s: float
    standoff_m: float


@dataclass(frozen=True, slots=True)
class Score:
    """The demo's figures; None where nothing was followed."""

    bearing_rms_deg: float | None
    distance_rms_frac: float | None
    time_on_target_frac: float | None
    max_setpoint_gap_s: float
    tracker_fps: float
    unsafe: int
    followed_s: float
    confirmations: int

    def to_json(self) -> str:
        """One line, figures rounded to what they are worth."""
        values = {k: round(v, 4) if isinstance(v, float) else v for k, v in asdict(self).items()}
        return json.dumps(values)


def read_truth(path: Path) -> list[TruthRow]:
    """All rows of the simulator's --truth file; a last line cut off is left out."""
    rows = []
    with path.open(encoding="utf-8") as file:
        for line in file:
            if line.endswith("\n"):
                rows.append(parse_truth(json.loads(line)))
    return sorted(rows, key=lambda row: row.t_s)


def parse_truth(fields: dict[str, Any]) -> TruthRow:
    """One line of the truth file; GcsError names what is missing."""
    try:
        vehicle, box = fields["vehicle"], fields["box_px"]
        return TruthRow(
            t_s=float(fields["t_s"]),
            vehicle_ned_m=_vec3(vehicle["position_ned_m"]),
            yaw_rad=float(fields.get("camera", vehicle)["roll_pitch_yaw_rad"][2]),
            target_ned_m=_vec3(fields["target"]["position_ned_m"]),
            box_xywh_px=None if box is None else (*map(float, box),),  # type: ignore[arg-type]
            visible_frac=float(fields["visible_frac"]),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise GcsError(f"the simulator's truth is not understood: {error!r}") from None


def _vec3(value: Sequence[float]) -> Vec3:
    north, east, down = map(float, value)
    return north, east, down


def nearest(rows: Sequence[TruthRow], t_s: float, within_s: float = _JOIN_S) -> TruthRow | None:
    """The row closest in time to t_s; rows in order of time."""
    at = bisect_left(rows, t_s, key=lambda row: row.t_s)
    around = rows[max(at - 1, 0) : at + 1]
    best = min(around, key=lambda row: abs(row.t_s - t_s), default=None)
    return best if best is not None and abs(best.t_s - t_s) <= within_s else None


def score(
    truth: Sequence[TruthRow],
    frames: Iterable[TrackedFrame],
    spans: Sequence[Span],
    *,
    max_setpoint_gap_s: float,
    unsafe: int,
    half_view_rad: float,
) -> Score:
    """Errors over every moment since the confirmation, the first one included; nothing is left out as settling.

    Time on target leaves out the frames in which something hides the target, but counts against us those in
    which it stands outside the picture (half_view_rad to either side).
    """
    bearings, distances = [], []
    for span in spans:
        for row in truth:
            if span.start_s <= row.t_s <= span.end_s:
                bearings.append(math.degrees(row.bearing_error_rad))
                distances.append(row.distance_m / span.standoff_m - 1)
    followed = [frame for frame in frames if any(s.start_s <= frame.t_capture_s <= s.end_s for s in spans)]
    followed_s = sum(span.end_s - span.start_s for span in spans)
    return Score(
        bearing_rms_deg=_rms(bearings),
        distance_rms_frac=_rms(distances),
        time_on_target_frac=_on_target_frac(truth, followed, half_view_rad),
        max_setpoint_gap_s=max_setpoint_gap_s,
        tracker_fps=len(followed) / followed_s if followed_s > 0 else 0.0,
        unsafe=unsafe,
        followed_s=followed_s,
        confirmations=len(spans),
    )


def _on_target_frac(truth: Sequence[TruthRow], frames: Iterable[TrackedFrame], half_view_rad: float) -> float | None:
    hits = []
    for frame in frames:
        row = nearest(truth, frame.t_capture_s)
        if row is None:
            continue
        if abs(row.bearing_error_rad) > half_view_rad:
            hits.append(False)
        elif row.is_visible and row.box_xywh_px is not None:
            hits.append(frame.box is not None and is_on(frame.box, Box.from_xywh(*row.box_xywh_px)))
    return sum(hits) / len(hits) if hits else None


def _rms(values: Sequence[float]) -> float | None:
    return math.sqrt(math.fsum(v * v for v in values) / len(values)) if values else None


def table(result: Score) -> str:
    """The figures for a person, one per line."""

    def figure(value: float | None, form: str) -> str:
        return "not followed" if value is None else form.format(value)

    rows = (
        ("followed", f"{result.followed_s:.0f} s"),
        ("bearing error rms", figure(result.bearing_rms_deg, "{:.2f} deg")),
        ("distance error rms", figure(result.distance_rms_frac, "{:.1%} of the standoff")),
        ("time on target", figure(result.time_on_target_frac, "{:.1%}")),
        ("longest setpoint gap", f"{result.max_setpoint_gap_s * 1000:.0f} ms"),
        ("tracker", f"{result.tracker_fps:.1f} frames per second"),
        ("unsafe events", f"{result.unsafe} (counted on the wire, by the simulator)"),
    )
    return "\n".join(f"  {name:<22}{value}" for name, value in rows)

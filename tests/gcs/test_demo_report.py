"""The demo's judgement: figures worked out by hand, truth files as the simulator writes them."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from gcs.demo_plot import plot
from gcs.demo_report import Score, Span, TrackedFrame, TruthRow, nearest, parse_truth, read_truth, score, table
from gcs.errors import GcsError
from gcs.truth import is_on
from tracker.box import Box

BOX = (100.0, 100.0, 40.0, 20.0)
HALF_VIEW_RAD = math.radians(35)


def row(t_s: float, bearing_deg: float = 0.0, distance_m: float = 10.0, visible: float = 1.0) -> TruthRow:
    """A vehicle at the origin that looks north, a target at this bearing and distance."""
    a = math.radians(bearing_deg)
    target = (distance_m * math.cos(a), distance_m * math.sin(a), 0.0)
    return TruthRow(t_s, (0.0, 0.0, -8.0), 0.0, target, BOX if visible > 0.2 else None, visible)


def judge(truth: list[TruthRow], frames: list[TrackedFrame], spans: list[Span]) -> Score:
    return score(truth, frames, spans, max_setpoint_gap_s=0.08, unsafe=0, half_view_rad=HALF_VIEW_RAD)


def test_errors_are_root_mean_squares_over_the_span_alone() -> None:
    truth = [row(0.0, 90.0, 99.0), row(1.0, 3.0, 11.0), row(2.0, -4.0, 9.0), row(3.0, 90.0, 99.0)]
    result = judge(truth, [], [Span(0.5, 2.5, 10.0)])
    assert result.bearing_rms_deg == pytest.approx(math.sqrt((9 + 16) / 2))
    assert result.distance_rms_frac == pytest.approx(0.1)
    assert result.followed_s == 2.0


def test_bearing_errors_wrap() -> None:
    r = TruthRow(0.0, (0.0, 0.0, 0.0), math.radians(179), (-10.0, -0.1, 0.0), None, 0.0)
    assert math.degrees(r.bearing_error_rad) == pytest.approx(1.57, abs=0.01)


def test_time_on_target_leaves_out_what_is_hidden_and_counts_what_has_left_the_picture() -> None:
    truth = [row(0.1), row(0.2, visible=0.0), row(0.3, bearing_deg=50.0, visible=0.0), row(0.4)]
    on = Box.from_xywh(*BOX)
    frames = [TrackedFrame(0.1, on), TrackedFrame(0.2, None), TrackedFrame(0.3, on), TrackedFrame(0.4, None)]
    assert judge(truth, frames, [Span(0.0, 1.0, 10.0)]).time_on_target_frac == pytest.approx(1 / 3)


def test_nothing_followed_gives_no_figures_rather_than_good_ones() -> None:
    result = judge([row(0.0)], [TrackedFrame(0.0, None)], [])
    assert result.bearing_rms_deg is None
    assert result.distance_rms_frac is None
    assert result.time_on_target_frac is None
    assert result.tracker_fps == 0.0
    assert "not followed" in table(result)


def test_frames_per_second_are_those_of_the_follow() -> None:
    frames = [TrackedFrame(t / 20, None) for t in range(100)]
    assert judge([row(0.0)], frames, [Span(1.0, 3.0, 10.0)]).tracker_fps == pytest.approx(20, rel=0.05)


def test_the_json_line_has_the_promised_keys() -> None:
    values = json.loads(judge([row(0.5)], [TrackedFrame(0.5, None)], [Span(0.0, 1.0, 10.0)]).to_json())
    promised = {"bearing_rms_deg", "distance_rms_frac", "time_on_target_frac", "max_setpoint_gap_s", "tracker_fps"}
    assert promised | {"unsafe"} <= set(values)


def test_overlap() -> None:
    box = Box.from_xywh(*BOX)
    assert is_on(box, box)
    assert not is_on(Box.from_xywh(141.0, 100.0, 40.0, 20.0), box)
    assert is_on(Box.from_xywh(120.0, 100.0, 40.0, 20.0), box)  # 1/3
    assert not is_on(Box.from_xywh(122.0, 100.0, 40.0, 20.0), box)


def test_the_nearest_row_within_reach() -> None:
    rows = [row(1.0), row(2.0)]
    assert nearest(rows, 1.04) is rows[0]
    assert nearest(rows, 1.97) is rows[1]
    assert nearest(rows, 1.5) is None
    assert nearest([], 1.0) is None


LINE = {
    "t_s": 12.5,
    "box_px": [1, 2, 3, 4],
    "visible_frac": 0.9,
    "vehicle": {"position_ned_m": [1, 2, -3], "roll_pitch_yaw_rad": [0, 0, 0.5]},
    "target": {"position_ned_m": [5, 6, 0]},
}


def test_truth_as_the_simulator_writes_it(tmp_path: Path) -> None:
    path = tmp_path / "truth.jsonl"
    path.write_text(json.dumps(LINE) + "\n" + json.dumps(LINE)[:40])  # the last line was being written
    rows = read_truth(path)
    assert rows == [TruthRow(12.5, (1, 2, -3), 0.5, (5, 6, 0), (1, 2, 3, 4), 0.9)]


def test_on_a_gimbal_it_is_the_cameras_heading_that_counts() -> None:
    assert parse_truth({**LINE, "camera": {"roll_pitch_yaw_rad": [0, -0.4, 0.9]}}).yaw_rad == 0.9


def test_truth_that_lacks_something_is_named() -> None:
    with pytest.raises(GcsError, match="visible_frac"):
        parse_truth({key: value for key, value in LINE.items() if key != "visible_frac"})


def test_the_plot_is_a_picture(tmp_path: Path) -> None:
    path = tmp_path / "plot.png"
    plot(path, [row(t / 20, bearing_deg=t / 10) for t in range(100)], [Span(1.0, 4.0, 10.0)], "test")
    assert path.read_bytes().startswith(b"\x89PNG")
    plot(path, [], [], "nothing was flown")

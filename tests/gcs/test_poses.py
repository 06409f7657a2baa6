from __future__ import annotations

from pathlib import Path

import pytest

from gcs.poses import PoseError, RecordedPoses

GOOD = (
    '{"t_s": 0.0, "roll_rad": 0, "pitch_rad": 0, "yaw_rad": 3.1}\n'
    '{"t_s": 0.1, "roll_rad": 0.2, "pitch_rad": -0.1, "yaw_rad": -3.1, "position_ned_m": [1, 2, -12]}\n'
)


def loaded(tmp_path: Path, text: str) -> RecordedPoses:
    path = tmp_path / "t.jsonl"
    path.write_text(text)
    return RecordedPoses.load(path)


def test_attitude_is_interpolated_the_short_way_round(tmp_path: Path) -> None:
    poses = loaded(tmp_path, GOOD)
    roll, pitch, yaw = poses.at(0.05).attitude_rpy_rad
    assert (roll, pitch) == pytest.approx((0.1, -0.05))
    assert abs(yaw) == pytest.approx(3.14159, abs=1e-3)
    assert poses.at(0.1).height_m == 12.0
    assert poses.at(0.1).yaw_rate_rps == pytest.approx((2 * 3.14159265 - 6.2) / 0.1)
    assert poses.at(0.05).height_m is None


def test_before_and_after_the_recording_its_ends_hold(tmp_path: Path) -> None:
    poses = loaded(tmp_path, GOOD)
    assert poses.at(-5.0).attitude_rpy_rad == (0, 0, 3.1)
    assert poses.at(99.0).attitude_rpy_rad == pytest.approx((0.2, -0.1, -3.1))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "no telemetry"),
        ("{}\n", r"t\.jsonl:1: .*t_s"),
        (GOOD + "words\n", r"t\.jsonl:3:"),
        (GOOD + GOOD, r"t\.jsonl:3: t_s 0 is not after"),
        ('{"t_s": 1e999, "roll_rad": 0, "pitch_rad": 0, "yaw_rad": 0}\n', r"t\.jsonl:1:"),
    ],
)
def test_what_is_no_telemetry_is_named_with_its_line(tmp_path: Path, text: str, why: str) -> None:
    with pytest.raises(PoseError, match=why):
        loaded(tmp_path, text)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(PoseError, match="no such file"):
        RecordedPoses.load(tmp_path / "none")

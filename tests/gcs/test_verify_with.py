"""`gcs replay FLIGHT --with CONFIG`, and the command line of both ways to fly again."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import cv2
import pytest

from control.gate_limits import TICK_S
from gcs.cli.entry import main
from gcs.errors import ConfigError
from gcs.verify.course import Course, apart
from gcs.verify.tuning import NothingChangedError, compare_with, laid_over
from gcs.verify.verify import Recorded, Start
from tests.gcs.verify_rig import record_flight


def quiet(text: str) -> None:
    """No progress is shown."""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    record_flight(folder)
    return folder


def written(folder: Path, text: str) -> Path:
    path = folder / "mine.yaml"
    path.write_text(text)
    return path


def test_a_lower_limit_of_speed_would_have_been_kept(flown: Path, tmp_path: Path) -> None:
    slow = "control:\n  follow:\n    max_speed_mps: 0.6\n  limits:\n    max_speed_mps: 0.6\n"
    found = compare_with(flown, written(tmp_path, slow), None, quiet)
    assert found.start is Start.CONTROL
    assert set(found.changed) == {"control.follow.max_speed_mps", "control.limits.max_speed_mps"}
    assert found.flown["speed, most m/s"] > 1.0
    assert found.otherwise["speed, most m/s"] <= 0.6 + 1e-6
    assert found.apart["velocity, rms m/s"] > 0.1
    image = cv2.imread(found.picture)
    assert image is not None
    assert image.std() > 5
    assert "max_speed_mps" in found.lines()[0]


def test_keys_that_the_file_leaves_out_are_the_flights(flown: Path, tmp_path: Path) -> None:
    config = Recorded.open(flown).config
    path = written(tmp_path, "control:\n  engagement:\n    lost_s: 0.7\n")
    laid = laid_over(config, path)
    assert laid.control.engagement.lost_s == 0.7
    assert laid.camera == config.camera
    assert laid.control.follow == config.control.follow


def test_a_shorter_patience_changes_the_states(flown: Path, tmp_path: Path) -> None:
    path = written(tmp_path, "control:\n  engagement:\n    lost_s: 0.5\n    release_s: 1.0\n")
    found = compare_with(flown, path, Start.CONTROL, quiet)
    assert found.apart["in another state, s"] > 0.3


def test_another_wish_takes_the_place_of_the_old_one(flown: Path, tmp_path: Path) -> None:
    found = compare_with(flown, written(tmp_path, "follow:\n  mode: spotlight\n"), None, quiet)
    assert found.otherwise["speed, most m/s"] < found.flown["speed, most m/s"] / 3


def test_a_file_that_says_nothing_new_is_refused(flown: Path, tmp_path: Path) -> None:
    with pytest.raises(NothingChangedError, match="says nothing that"):
        compare_with(flown, written(tmp_path, "{}\n"), None, quiet)
    with pytest.raises(ConfigError, match=r"mine\.yaml:1: .*unknown key"):
        compare_with(flown, written(tmp_path, "speed: 3\n"), None, quiet)


def test_the_figures_of_a_course() -> None:
    a, b = Course(), Course()
    for course, north_mps in ((a, 1.0), (b, 0.5)):
        for index in range(5):
            course.t_s.append(index * TICK_S)
            course.north_mps.append(north_mps * index)
            course.east_mps.append(0.0)
            course.down_mps.append(0.0)
            course.yaw_rate_rps.append(math.nan if index == 0 else 0.1)
            course.states.append("following" if index < 3 or course is a else "coasting")
    figures = a.figures()
    assert figures["speed, most m/s"] == 4.0
    assert figures["speed, rms m/s"] == pytest.approx(math.sqrt(30 / 5))
    assert figures["acceleration asked for, rms m/s2"] == pytest.approx(1.0 / TICK_S)
    assert figures["yaw rate, rms deg/s"] == pytest.approx(math.degrees(0.1))
    assert apart(a, b)["velocity, most m/s"] == 2.0
    assert apart(a, b)["in another state, s"] == pytest.approx(2 * TICK_S)


def test_the_command_proves_and_says_so(flown: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(flown), "--verify", "--from", "control"]) == 0
    assert "the same to the last bit: " in capsys.readouterr().out


def test_without_a_film_nothing_is_proved(flown: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The tracker was asked for and none of its boxes was made again: a 0 would be believed by a script."""
    assert main(["replay", str(flown), "--verify"]) == 1
    out = capsys.readouterr().out
    assert out.startswith("NOT PROVED")
    assert re.search(r"\nonly 0 of \d+ pictures could be tracked again: use --from control\n", out)
    assert "note: " in out
    assert "no film" in out


def test_json_is_one_line(flown: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(flown), "--verify", "--from", "control", "--json"]) == 0
    verdict = json.loads(capsys.readouterr().out)
    assert verdict["exact"] is True
    assert verdict["start"] == "control"
    path = written(tmp_path, "control:\n  follow:\n    max_speed_mps: 0.6\n")
    assert main(["replay", str(flown), "--with", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["changed"]["control.follow.max_speed_mps"][1] == 0.6


def test_a_folder_that_is_no_flight_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(tmp_path), "--verify"]) == 2
    assert capsys.readouterr().err.count("\n") == 1

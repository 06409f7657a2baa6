"""Profiles below files below arguments; where each value comes from; what `gcs config` prints."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import pytest

from gcs.cli import entry as cli
from gcs.cli.args_operator import with_operator_arguments
from gcs.config import Config, load, load_with_origins
from gcs.errors import EXIT_USAGE, ConfigError, GcsError
from gcs.profiles import profile_names, profile_text


def written(tmp_path: Path, text: str) -> str:
    path = tmp_path / "c.yaml"
    path.write_text(text)
    return str(path)


def shown(capsys: pytest.CaptureFixture[str], *argv: str) -> str:
    assert cli.main(["config", *argv]) == 0
    out: str = capsys.readouterr().out
    return out


def rows(capsys: pytest.CaptureFixture[str], *argv: str) -> dict[str, dict[str, object]]:
    lines = shown(capsys, "--explain", "--json", *argv).splitlines()
    return {row["key"]: row for row in map(json.loads, lines)}


@pytest.mark.parametrize("name", profile_names())
def test_a_profile_loads_says_what_it_is_and_accepts_nothing_unsafe(name: str) -> None:
    config = load(None, name)
    assert config != Config()
    assert len(profile_text(name)) > 20
    assert config.vehicle.accept_parameters == ()
    assert not config.mavlink_camera.may_follow


def test_the_profiles_that_people_ask_for_are_there() -> None:
    assert {"px4-sitl", "ardupilot-sitl", "radio"} <= set(profile_names())
    assert load(None, "radio").vehicle.url == "serial:///dev/ttyUSB0:57600"


def test_a_file_wins_over_a_profile_key_by_key(tmp_path: Path) -> None:
    path = written(tmp_path, "control:\n  follow:\n    max_speed_mps: 3\nvehicle:\n  timeout_s: 9\n")
    laid = load_with_origins(path, "radio")
    assert laid.value.vehicle.timeout_s == 9
    assert laid.value.vehicle.url.startswith("serial:")  # the profile's
    assert laid.value.control.follow.max_speed_mps == 3
    assert laid.value.control.follow.min_distance_m == 6  # the profile's, of the same section
    assert str(laid.origins["vehicle.timeout_s"].path) == path
    assert laid.origins["vehicle.timeout_s"].line == 5
    assert laid.origins["vehicle.url"].path.name == "radio.yaml"
    assert "vehicle.system_id" not in laid.origins


def test_a_clash_between_layers_names_the_line_that_can_be_changed(tmp_path: Path) -> None:
    path = written(tmp_path, "\ncontrol:\n  limits:\n    max_speed_mps: 4\n")
    with pytest.raises(ConfigError, match=r"follow.max_speed_mps 5 is above"):
        load(path, "radio")


def test_an_unknown_profile_names_those_there_are(capsys: pytest.CaptureFixture[str]) -> None:
    for command in (["config", "--explain"], ["audit"], ["doctor", "--quick"], ["dry-run", "x.mp4"]):
        assert cli.main([*command, "--profile", "px5"]) == EXIT_USAGE
        assert "no profile 'px5'; there are: ardupilot-sitl, px4-sitl" in capsys.readouterr().err


def test_each_source_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, "vehicle:\n  timeout_s: 9\n")
    found = rows(
        capsys, path, "--profile", "radio", "--port", "9000", "--accept", "COM_RC_OVERRIDE", "--qgc", "udpout://h:1"
    )
    assert found["vehicle.timeout_s"]["source"] == f"{path}:2"
    assert str(found["vehicle.url"]["source"]).startswith("profile radio:")
    assert found["page.port"] == {
        "key": "page.port", "value": 9000, "default": 8870, "unit": "", "low": 0, "high": 65535, "choices": [],
        "source": "command line", "meaning": "0 takes a free one",
    }  # fmt: skip
    assert found["vehicle.accept_parameters"]["source"] == "command line"
    assert found["mavlink_camera.url"]["value"] == "udpout://h:1"
    assert found["vehicle.system_id"]["source"] == "default"
    assert found["vehicle.backend"]["choices"] == ["setpoints", "follow-target"]
    assert found["control.engagement.lost_s"]["meaning"] == "T_lost: velocity is zero"
    assert found["camera.glass_delay_s"]["unit"] == "s"
    assert len(found) > 100


def test_keys_and_changes_narrow_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert set(rows(capsys, "page.port", "follow")) == {
        "page.port", "follow.mode", "follow.standoff_m", "follow.distance_m",
    }  # fmt: skip
    assert all(row["source"] != "default" for row in rows(capsys, "--changed", "--profile", "sim").values())
    text = shown(capsys, "--explain", "--profile", "sim", "vehicle.url", "vehicle.timeout_s")
    assert "* vehicle.url = udpin://127.0.0.1:14540" in text
    assert "  vehicle.timeout_s = 15 s" in text
    assert "default | from 1 to 300" in text


def test_a_secret_is_not_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, "page:\n  token: abcdefghijklmnop\n")
    assert "abcdefghijklmnop" not in shown(capsys, "--explain", path)
    assert rows(capsys, path, "page.token")["page.token"]["value"] == "(secret)"


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["vehicle.urk"], "neither a file nor a key of the configuration (did you mean vehicle.url?)"),
        (["page.port"], "`gcs config --explain page.port`"),
        (["a.yaml", "b.yaml"], "only one file"),
        (["none.yaml"], "none.yaml: no such file"),
        (["--explain", "--port", "99999"], "--port 99999: must be from 0 to 65535"),
        (["--profiles", "px5"], "no profile 'px5'"),
    ],
)
def test_what_cannot_be_is_one_line(argv: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["config", *argv]) == EXIT_USAGE
    shown = capsys.readouterr()
    assert words in shown.err
    assert shown.out == ""
    assert len(shown.err.splitlines()) == 1


def test_what_is_printed_of_a_profile_loads_as_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, shown(capsys, "--profile", "radio", "--vehicle", "udpout://[::1]:14550"))
    wanted = load(None, "radio")
    assert load(path).control == wanted.control
    assert load(path).vehicle.url == "udpout://[::1]:14550"


def test_the_profiles_are_listed_and_printed(capsys: pytest.CaptureFixture[str]) -> None:
    listed = shown(capsys, "--profiles")
    assert all(name in listed for name in profile_names())
    assert "57600" in shown(capsys, "--profiles", "radio")


def test_operator_arguments_win() -> None:
    def given(**values: object) -> Config:
        return with_operator_arguments(Config(), argparse.Namespace(**values))

    assert given() == Config()  # a command that has none of them
    assert not given(no_page=True).page.enabled
    assert not given(headless=True).page.enabled
    assert given(port=0).page.port == 0
    assert given(rtsp=8554).video_out.rtsp_port == 8554
    assert given(qgc="udpout://h:14550").mavlink_camera.url == "udpout://h:14550"
    with pytest.raises(GcsError, match="--rtsp 0"):
        given(rtsp=0)

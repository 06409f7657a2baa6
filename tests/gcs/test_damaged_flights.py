"""Flights that come from elsewhere, are damaged, or are still being written; tests.fuzz does it by the thousand."""

from __future__ import annotations

import json
import os
import re
import shutil
from array import array
from pathlib import Path

import pytest

from control.engagement import State
from gcs.cli.entry import main
from gcs.errors import EXIT_USAGE
from gcs.json_line import json_line
from gcs.recorder.events import Ordered, Said
from gcs.recorder.folder import FlightFolder
from gcs.recorder.manifest import ManifestError, read_manifest
from gcs.replay.log import FlightLog, TickRow
from gcs.replay.order import in_order
from gcs.result_file import result_file
from tests.gcs.report_rig import START_S, tick, write_log
from tests.gcs.tlog_rig import UNIX_S, vehicle_frames, write_records
from tests.gcs.verify_rig import record_flight

HOSTILE = "\x1b]0;owned\x07\x1b[2J\x9b31m\u202e<script>alert(1)</script>"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded")
    record_flight(folder)
    return folder


@pytest.fixture
def flight(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "flight"))


def ways(flight: Path, out: Path) -> list[list[str]]:
    """Everything that reads a flight and ends by itself."""
    return [
        ["replay", str(flight), "--no-page", "--speed", "20"], ["replay", str(flight), "--verify", "--from", "control"],
        ["report", str(flight), "--html", str(out / "r.html")], ["report", str(flight), "--json"],
        ["export", str(flight), "--mcap", str(out / "x.mcap")],
    ]  # fmt: skip


def hostile_log(folder: Path) -> Path:
    entries: list[tuple[float, object]] = [(START_S + 0.05 * n, tick(0.05 * n, State.IDLE)) for n in range(20)]
    return write_log(
        folder, [*entries, (START_S + 1.0, Said(HOSTILE)), (START_S + 1.0, Ordered(HOSTILE, HOSTILE, refused=True))]
    )


def test_what_was_recorded_does_not_steer_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for argv in ways(hostile_log(tmp_path / "flight"), tmp_path):
        main(argv)
        told = capsys.readouterr()
        if "--json" in argv:
            json.loads(told.out)
        assert not [char for char in told.out + told.err if not char.isprintable() and char != "\n"]
    assert "<script" not in (tmp_path / "r.html").read_text()


def test_what_a_program_reads_is_escaped_but_the_same() -> None:
    line = json_line({"text": HOSTILE})
    assert line.isascii()
    assert json.loads(line) == {"text": HOSTILE}


@pytest.mark.parametrize("name", ["messages.jsonl", "manifest.json"])
def test_what_is_no_file_is_one_line(flight: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    for make in (
        lambda path: os.mkfifo(path), lambda path: path.mkdir(), lambda path: path.symlink_to("/dev/zero"),
        lambda path: path.symlink_to(path.name),
    ):  # fmt: skip
        (flight / name).rmdir() if (flight / name).is_dir() else (flight / name).unlink()
        make(flight / name)
        assert main(["replay", str(flight), "--verify", "--from", "control"]) == EXIT_USAGE
        (line,) = capsys.readouterr().err.splitlines()
        assert name in line


def test_a_result_replaces_a_link_and_no_record(flight: Path, tmp_path: Path) -> None:
    elsewhere, before = tmp_path / "elsewhere", (flight / "messages.jsonl").read_bytes()
    elsewhere.write_text("mine")
    for name in ("report.html", "report.html.new", "flight.mcap", "flight.mcap.new"):
        (flight / name).symlink_to(elsewhere)
    assert main(["report", str(flight)]) == 0
    assert main(["export", str(flight)]) == 0
    assert elsewhere.read_text() == "mine"
    for argv in (["report", "--html"], ["export", "--mcap"], ["replay", "--film"]):
        assert main([argv[0], str(flight), argv[1], str(flight / "messages.jsonl")]) == EXIT_USAGE
    assert (flight / "messages.jsonl").read_bytes() == before


def test_a_result_that_is_not_finished_leaves_what_was_there(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("before")
    with pytest.raises(TypeError), result_file(tmp_path / "a") as file:
        file.writelines([b"half", None])  # type: ignore[list-item]
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("a", "before")]


def test_a_damaged_time_shifts_its_own_line_alone() -> None:
    assert list(in_order(array("d", [1.0, 2.0, 1e9, 3.0, -7e8, 4.0]))) == [1.0, 2.0, 2.0, 3.0, 3.0, 4.0]
    assert list(in_order(array("d", [1e9, 1.0, 2.0]))) == [1.0, 1.0, 2.0]
    assert list(in_order(array("d", [1.0, 2.0, 1.9, 3.0]))) == [1.0, 2.0, 2.0, 3.0]  # written a little later


def test_the_rest_of_a_log_is_read(flight: Path) -> None:
    lines = (flight / "messages.jsonl").read_bytes().splitlines()
    whole = sum(isinstance(message, TickRow) for _, _, message in FlightLog(flight))
    damage = [
        b'{"n":' + b"[" * 100_000,
        b"\xff\xfe\x00",
        b'{"n":1,"t_s":1e300,"type":"Said","data":{"text":""}}',
        b'{"x',
    ]
    lines[100:100] = damage
    (flight / "messages.jsonl").write_bytes(b"\n".join(lines))
    log = FlightLog(flight)
    assert sum(isinstance(message, TickRow) for _, _, message in log) == whole
    assert log.damaged == len(damage)


def test_a_configuration_beyond_all_ranges_is_named(flight: Path) -> None:
    values = json.loads((flight / "manifest.json").read_bytes())
    values["config"]["camera"]["hfov_deg"] = 1e6
    (flight / "manifest.json").write_text(json.dumps(values))
    with pytest.raises(ManifestError, match=r"camera\.hfov_deg: must be from 5 to 170"):
        read_manifest(flight).configuration.camera  # noqa: B018 - it is read


def test_a_flight_in_progress_is_read_as_far_as_it_stands(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written = (flight / "messages.jsonl").read_bytes()
    (flight / "messages.jsonl").write_bytes(written[: len(written) // 2])
    folder = FlightFolder(flight)
    for argv in ways(flight, tmp_path):
        assert main(argv) == 0
        told = capsys.readouterr()
        assert "still being recorded" in told.out + told.err
        assert "in order" not in told.out
    folder.close()


def test_stamps_that_are_no_time_do_not_stop_an_import(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames = vehicle_frames(3.0)
    for at, t_s in ((0, 1.8e13), (40, 1.7e13), (90, UNIX_S + 3500.0)):
        frames[at] = t_s, frames[at][1]
    log = write_records(tmp_path / "a.tlog", frames)
    assert main(["import", str(log), "--out", str(tmp_path / "flight")]) == 0
    assert "the clock was set" in capsys.readouterr().err
    assert (
        main(["import", str(log), "--out", str(tmp_path / "b"), "--video", "x.mp4", "--offset", "1e300"]) == EXIT_USAGE
    )


def test_a_time_that_cannot_be_is_told_and_leaves_the_rest_the_same(
    flight: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = (flight / "messages.jsonl").read_bytes().splitlines()
    at = next(at for at in range(800, len(lines)) if b'"type":"Received"' in lines[at])
    lines[at] = re.sub(rb'"t_s":[0-9.]+', b'"t_s":9e8', lines[at], count=1)
    (flight / "messages.jsonl").write_bytes(b"\n".join(lines))
    assert main(["report", str(flight), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["lasted_s"] < 60.0
    assert any("a time that cannot be" in problem for problem in told["problems"])
    main(["replay", str(flight), "--verify", "--from", "control"])
    assert "1 lines of the log have a time that cannot be" in capsys.readouterr().out

"""Folders of flights: their names, their lock, the list of them, and how one is found."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from gcs.cli.entry import main
from gcs.clock import FakeClock
from gcs.config import Config
from gcs.errors import GcsError
from gcs.recorder import facts, folder
from gcs.recorder.flights import State, find_flight, list_flights
from gcs.recorder.folder import FolderError, demo_folder, given_folder, has_own_name, is_in_progress, new_folder
from gcs.recorder.manifest import MANIFEST, write_manifest
from gcs.recorder.message_log import MessageLog


def flight(where: Path, name: str, started_s: float, *, ended: bool = True, kind: str = "run", kb: int = 0) -> Path:
    """A folder with a manifest and a message a minute after the start."""
    path = where / name
    path.mkdir(parents=True)
    manifest = facts.gather(kind, Config(), FakeClock(100.0), vehicle="udpin://0.0.0.0:14540")
    values = {"unix_start_s": started_s, "ended": facts.utc(started_s + 99.0) if ended else None, "follows": 2}
    write_manifest(path, msgspec.structs.replace(manifest, **values))
    with MessageLog(path / "messages.jsonl") as log:
        log.write(160.0, manifest)
    (path / "film.mjpeg").write_bytes(bytes(1000 * kb))
    return path


def test_each_flight_has_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folder.time, "strftime", lambda _: "flight-20260504-103000")
    made = [new_folder(tmp_path / "out") for _ in range(3)]
    assert [each.path.name for each in made] == [
        "flight-20260504-103000",
        "flight-20260504-103000-2",
        "flight-20260504-103000-3",
    ]
    assert all(has_own_name(each.path) and is_in_progress(each.path) for each in made)
    for each in made:
        each.close()
        each.close()
    assert not any(is_in_progress(each.path) for each in made)
    assert not has_own_name(tmp_path / "flight-20260504-103000-to-keep")


def test_a_folder_that_holds_a_flight_is_not_written_over(tmp_path: Path) -> None:
    path = flight(tmp_path, "mine", 1e9)
    with pytest.raises(FolderError, match=f"^{path}: holds a flight already"):
        given_folder(path)
    (path / MANIFEST).unlink()  # of an earlier version
    with pytest.raises(FolderError, match=f"^{path}: holds a flight already"):
        given_folder(path)
    empty = given_folder(tmp_path / "a" / "b")
    with pytest.raises(FolderError, match="another flight is being recorded there"):
        given_folder(empty.path)
    empty.close()


def test_a_folder_that_cannot_be_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    for make in (given_folder, demo_folder, new_folder):
        with pytest.raises(FolderError, match=r"file: no flight can be recorded there: (file exists|not a directory)$"):
            make(tmp_path / "file")


def test_a_demo_replaces_a_demo_and_nothing_else(tmp_path: Path) -> None:
    path = flight(tmp_path, "demo", 1e9, kind="demo")
    for name in ("flight.tlog", "film.h264", "film-2.h264", "film.jsonl", "report.html", "notes.txt", "films"):
        (path / name).write_text("old")
    demo_folder(path).close()
    assert sorted(each.name for each in path.iterdir()) == ["films", "notes.txt"]
    real = flight(tmp_path, "real", 1e9)
    with pytest.raises(FolderError, match=r"real: holds a flight \(of gcs run\); give another folder with --out"):
        demo_folder(real)
    (real / MANIFEST).write_text("{")
    with pytest.raises(GcsError, match="not a manifest"):
        demo_folder(real)
    assert (real / "messages.jsonl").exists()


def test_a_demo_takes_no_folder_whose_flight_has_lost_its_manifest(tmp_path: Path) -> None:
    for name in ("messages.jsonl", "film.mp4", "flight.gpx", "report.html"):
        folder = tmp_path / name.split(".")[0]
        folder.mkdir()
        (folder / name).write_text("kept")
        with pytest.raises(FolderError, match=rf"{name}: of a flight without manifest.json; give another folder"):
            demo_folder(folder)
        assert [each.name for each in folder.iterdir()] == [name]


def test_what_had_not_begun_leaves_nothing(tmp_path: Path) -> None:
    made = new_folder(tmp_path)
    (made.path / "film.mjpeg").write_bytes(b"x")
    made.discard()
    assert list(tmp_path.iterdir()) == []


def test_the_lock_ends_with_its_program(tmp_path: Path) -> None:
    code = (
        f"from pathlib import Path; from gcs.recorder.folder import *; f = given_folder(Path({str(tmp_path / 'f')!r}))"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", f"{code}; print('made', flush=True); import time; time.sleep(60)"],
        stdout=subprocess.PIPE,
    )
    assert child.stdout is not None
    child.stdout.readline()
    assert is_in_progress(tmp_path / "f")
    child.kill()
    child.wait()
    child.stdout.close()
    assert (tmp_path / "f" / folder.LOCK).exists()
    assert not is_in_progress(tmp_path / "f")


def test_the_list_tells_how_each_flight_stands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flight(tmp_path, "flight-20010909-014640", 1e9, kb=1500)
    flight(tmp_path, "broken", 2e9, ended=False)
    flying = folder.FlightFolder(flight(tmp_path, "flying", 3e9, ended=False))
    (tmp_path / "no-flight").mkdir()
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / MANIFEST).write_text("{")
    found = list_flights(tmp_path)
    assert [(each.path.name, each.state) for each in found] == [
        ("flying", State.IN_PROGRESS),
        ("broken", State.BROKEN_OFF),
        ("flight-20010909-014640", State.ENDED),
        ("damaged", State.UNREADABLE),
    ]
    assert found[2].length_s == 60.0
    assert found[2].follows == 2
    assert 1.5e6 < found[2].size_bytes < 1.6e6
    assert main(["flights", "--folder", str(tmp_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["flight", "started", "length", "size", "kind", "vehicle", "follows", "state"]
    assert lines[3].endswith("1:00  1.5 MB  run   udpin://0.0.0.0:14540        2  ended")
    assert lines[5].startswith(f"  ! {tmp_path / 'damaged' / MANIFEST}: not a manifest")
    assert main(["flights", "--folder", str(tmp_path), "--json"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [row["state"] for row in rows] == ["in progress", "broken off", "ended", "unreadable"]
    flying.close()


def test_a_folder_without_flights(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["flights", "--folder", str(tmp_path)]) == 0
    assert main(["flights", "--folder", str(tmp_path), "--json"]) == 0
    assert main(["flights", "--folder", str(tmp_path / "none")]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.splitlines() == ["no flights are recorded there", f"gcs: {tmp_path / 'none'}: no such folder"]


def test_a_flight_is_found_by_path_by_name_or_as_the_last(tmp_path: Path) -> None:
    old, new = flight(tmp_path, "old", 1e9), flight(tmp_path, "new", 2e9)
    assert find_flight(str(old), Path("elsewhere")) == old
    assert find_flight("old", tmp_path) == old
    assert find_flight("last", tmp_path) == new
    with pytest.raises(GcsError, match=rf"^other: no such flight, neither a folder nor a name in {tmp_path}"):
        find_flight("other", tmp_path)
    with pytest.raises(GcsError, match=r"messages\.jsonl: is a file; give the folder of the flight"):
        find_flight(str(old / "messages.jsonl"), tmp_path)
    with pytest.raises(GcsError, match="none: no flight is recorded there"):
        find_flight("last", tmp_path / "none")


def test_a_length_is_told_without_a_log_too(tmp_path: Path) -> None:
    path = flight(tmp_path, "flight", 1e9)
    with (path / "messages.jsonl").open("ab") as file:
        file.write(b'{"n": 1, "t_s": 17')
    assert list_flights(tmp_path)[0].length_s == 60.0  # the last whole line
    (path / "messages.jsonl").unlink()
    assert list_flights(tmp_path)[0].length_s is not None

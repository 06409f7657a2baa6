"""The oldest flights make room; nobody else's, none in progress, nothing outside."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from gcs.recorder.folder import FlightFolder
from gcs.recorder.manifest import MANIFEST
from gcs.recorder.retention import Retention, removable, remove, size_bytes
from tests.gcs.test_flights import flight


def name(number: int) -> str:
    return f"flight-2001090{number}-014640"


def kept(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def tidy(folder: Path, keep_bytes: float, own: Path) -> list[str]:
    """One look round; what was said."""
    said: list[str] = []
    looked = threading.Event()

    class Once(Retention):
        def _tidy(self) -> None:
            super()._tidy()
            looked.set()

    retention = Once(folder, keep_bytes, own, said.append)
    assert looked.wait(10.0)
    retention.close()
    return said


def test_the_oldest_go_until_there_is_room(tmp_path: Path) -> None:
    for number in (1, 2, 3, 4):
        flight(tmp_path, name(number), 1e9 - 1000 * number, kb=1000)  # the highest number is the oldest
    own = flight(tmp_path, name(9), 1e6, ended=False, kb=1000)
    said = tidy(tmp_path, 3.5e6, own)
    assert kept(tmp_path) == [name(1), name(2), name(9)]
    assert len(said) == 2
    assert said[0] == f"record: {tmp_path / name(4)} was removed, 0.00 GB: recorder.keep_gb is reached"


def test_a_flight_larger_than_all_room_stays(tmp_path: Path) -> None:
    old, own = flight(tmp_path, name(1), 1e9, kb=10), flight(tmp_path, name(2), 2e9, kb=3000)
    tidy(tmp_path, 1e6, own)
    assert not old.exists()
    assert own.exists()


def test_only_flights_of_our_own_naming_go(tmp_path: Path) -> None:
    out = tmp_path / "out"
    flight(out, "the-good-one", 1e9, kb=1000)  # renamed to keep it
    flight(out, name(1), 1e9, kind="demo", kb=1000)
    flight(out, name(2), 1e9, kb=1000)
    (out / name(2) / MANIFEST).write_text("{")  # who knows what it is
    (out / name(3)).mkdir()
    outside = flight(tmp_path, name(4), 1e9, kb=1000)
    (out / name(4)).symlink_to(outside)
    (out / name(5)).write_text("a file")
    flying = FlightFolder(flight(out, name(6), 1e9, ended=False, kb=1000))
    own = flight(out, name(7), 1e9, ended=False)
    before = kept(out)
    assert removable(out, own) == []
    assert tidy(out, 1.0, own) == []
    assert kept(out) == before
    assert (outside / MANIFEST).exists()
    flying.close()
    assert [each.path.name for each in removable(out, own)] == [name(6)]


def test_links_within_a_flight_are_not_followed(tmp_path: Path) -> None:
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "file").write_bytes(bytes(5_000_000))
    path = flight(tmp_path, name(1), 1e9)
    (path / "link").symlink_to(precious)
    (path / "file-link").symlink_to(precious / "file")
    (path / "pictures").mkdir()
    (path / "pictures" / "a.png").write_bytes(b"x")
    assert size_bytes(path) < 100_000
    remove(path)
    assert not path.exists()
    assert (precious / "file").exists()


def test_what_cannot_be_removed_is_said_and_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, own = flight(tmp_path, name(1), 1e9, kb=1000), flight(tmp_path, name(2), 2e9)

    def refuse(self: Path, missing_ok: bool = False) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "unlink", refuse)
    assert tidy(tmp_path, 1.0, own) == [f"record: {path} cannot be removed: permission denied"]
    assert (path / MANIFEST).exists()

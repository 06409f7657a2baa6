"""The folder of one flight: made, locked while the flight is in progress, never written over."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import time
from pathlib import Path
from typing import Final

from gcs.errors import GcsError
from gcs.recorder.manifest import MANIFEST, read_manifest

LOCK: Final = "in-progress.lock"
_OURS: Final = (
    MANIFEST,
    f"{MANIFEST}.new",
    "messages.jsonl",
    "flight.*",
    "film.*",
    "film-*",
    "report.html",
    "with-*.png",
)
_NAME: Final = re.compile(r"flight-\d{8}-\d{6}(-\d+)?")
_MOST_A_SECOND: Final = 100
_LOCK_TRIES: Final = 20


class FolderError(GcsError):
    """A folder that cannot take a flight's record; names it."""


class FlightFolder:
    """Of the flight in progress: others see so by a lock that ends with this program, however it ends."""

    def __init__(self, path: Path) -> None:
        """Of a folder that is there. FolderError where another program writes its flight there."""
        self.path = path
        try:
            self._lock: int | None = os.open(path / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise refused(path, error) from error
        for _ in range(_LOCK_TRIES):
            try:
                fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return
            except BlockingIOError:
                time.sleep(0.01)  # `gcs flights` looks, for a moment
            except OSError:
                return  # a file system without locks
        os.close(self._lock)
        raise FolderError(f"{path}: another flight is being recorded there")

    def close(self) -> None:
        """The flight has ended."""
        if self._lock is None:
            return
        with contextlib.suppress(OSError):
            (self.path / LOCK).unlink(missing_ok=True)
        os.close(self._lock)
        self._lock = None

    def discard(self) -> None:
        """There was no flight: what was begun goes, and the folder with it if nothing else is in it."""
        with contextlib.suppress(OSError):
            _clear(self.path)
        self.close()
        with contextlib.suppress(OSError):
            self.path.rmdir()


def is_in_progress(path: Path) -> bool:
    """Whether a program that lives is writing a flight there."""
    try:
        lock = os.open(path / LOCK, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(lock)
    return False


def in_progress_note(path: Path) -> list[str]:
    """For whoever reads a flight that is being written: nothing more where it is not."""
    return ["the flight is still being recorded: it is read as far as it stands"] if is_in_progress(path) else []


def has_own_name(path: Path) -> bool:
    """Whether it is called as `new_folder` calls them; what a person named is the person's."""
    return _NAME.fullmatch(path.name) is not None


def new_folder(where: Path) -> FlightFolder:
    """flight-YYYYMMDD-HHMMSS in there (local time), of this flight alone. FolderError where it cannot be made."""
    name = time.strftime("flight-%Y%m%d-%H%M%S")
    try:
        where.mkdir(parents=True, exist_ok=True)
        for number in range(1, _MOST_A_SECOND):
            path = where / (name if number == 1 else f"{name}-{number}")
            with contextlib.suppress(FileExistsError):
                path.mkdir()
                return FlightFolder(path)
    except OSError as error:
        raise refused(where, error) from error
    raise FolderError(f"{where / name}: exists, and {_MOST_A_SECOND - 2} others of this second")


def given_folder(path: Path) -> FlightFolder:
    """This very folder. FolderError where a flight is in it already, or it cannot be made."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        if _first_of_ours(path) is not None:
            raise FolderError(f"{path}: holds a flight already; give another folder, or move that one away")
    except OSError as error:
        raise refused(path, error) from error
    return FlightFolder(path)


def demo_folder(path: Path) -> FlightFolder:
    """This one, in place of an earlier demo there. FolderError where anything else is in it, or it cannot be made."""
    was_demo = (path / MANIFEST).exists()
    if was_demo and (kind := read_manifest(path).kind) != "demo":
        raise FolderError(f"{path}: holds a flight (of gcs {kind}); give another folder with --out")
    try:
        path.mkdir(parents=True, exist_ok=True)
        if not was_demo and (found := _first_of_ours(path)) is not None:
            raise FolderError(f"{found}: of a flight without {MANIFEST}; give another folder with --out")
        folder = FlightFolder(path)
        _clear(path)
    except OSError as error:
        raise refused(path, error) from error
    return folder


def _first_of_ours(path: Path) -> Path | None:
    return next((each for pattern in _OURS for each in path.glob(pattern)), None)


def _clear(path: Path) -> None:
    for pattern in _OURS:
        for each in path.glob(pattern):
            each.unlink()


def refused(path: Path, error: OSError) -> FolderError:
    """For the operator."""
    return FolderError(f"{path}: no flight can be recorded there: {(error.strerror or str(error)).lower()}")

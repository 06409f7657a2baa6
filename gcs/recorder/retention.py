"""Room for the flights to come: the oldest are removed once all together are larger than they may be."""

from __future__ import annotations

import contextlib
import shutil
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gcs.recorder.folder import has_own_name, is_in_progress
from gcs.recorder.manifest import MANIFEST, ManifestError, read_manifest

_LOOK_S: Final = 60.0
GB: Final = 1e9


@dataclass(frozen=True, slots=True, order=True)
class Kept:
    """A flight that may be removed; started: seconds since 1970."""

    started: float
    path: Path
    size_bytes: int


def size_bytes(path: Path) -> int:
    """Of all files in a folder; links count as themselves."""
    total = 0
    for each in path.rglob("*"):
        with contextlib.suppress(OSError):
            total += each.lstat().st_size
    return total


def removable(folder: Path, own: Path | None = None) -> list[Kept]:
    """Flights of `gcs run` in there, the oldest first; none in progress, none that a person has named or linked."""
    found = []
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            if path == own or path.is_symlink() or not has_own_name(path):
                continue
            with contextlib.suppress(ManifestError):
                manifest = read_manifest(path)
                if manifest.kind == "run" and not is_in_progress(path):
                    found.append(Kept(manifest.unix_start_s, path, size_bytes(path)))
    return sorted(found)


def remove(path: Path) -> None:
    """The manifest last, so that a flight half removed is still known for one. OSError."""
    for each in path.iterdir():
        if each.name == MANIFEST:
            continue
        if each.is_dir() and not each.is_symlink():
            shutil.rmtree(each)
        else:
            each.unlink()
    (path / MANIFEST).unlink(missing_ok=True)
    path.rmdir()


class Retention:
    """Looks at the start of a flight and once a minute, on a thread of its own.

    own: folder of the flight in progress, which counts but stays. say: called on that thread.
    """

    def __init__(self, folder: Path, keep_bytes: float, own: Path, say: Callable[[str], None]) -> None:
        self._folder, self._own = folder, own
        self._keep_bytes = keep_bytes
        self._say = say
        self._kept: list[Kept] | None = None
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="retention", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End it, after the flight that is being removed."""
        self._stopping.set()
        self._thread.join(1.0)

    def _run(self) -> None:
        while True:
            self._tidy()
            if self._stopping.wait(_LOOK_S):
                return

    def _tidy(self) -> None:
        if self._kept is None:  # those that have ended grow no more
            self._kept = removable(self._folder, self._own)
        total = size_bytes(self._own) + sum(kept.size_bytes for kept in self._kept)
        while self._kept and total > self._keep_bytes and not self._stopping.is_set():
            oldest = self._kept.pop(0)
            total -= oldest.size_bytes
            self._remove(oldest)

    def _remove(self, oldest: Kept) -> None:
        if not (oldest.path / MANIFEST).exists():
            return  # somebody else has
        try:
            remove(oldest.path)
            text = f"{oldest.path} was removed, {oldest.size_bytes / GB:.2f} GB: recorder.keep_gb is reached"
        except OSError as error:
            text = f"{oldest.path} cannot be removed: {(error.strerror or str(error)).lower()}"
        self._say(f"record: {text}")

"""The recorded flights of a folder, told from their manifests and the last lines of their logs."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from datetime import datetime
from enum import Enum
from pathlib import Path
from typing import Final

import msgspec

from gcs.errors import GcsError
from gcs.recorder.flight_recorder import MESSAGES
from gcs.recorder.folder import is_in_progress
from gcs.recorder.manifest import MANIFEST, Manifest, ManifestError, read_manifest
from gcs.recorder.retention import size_bytes
from gcs.recorder.seconds import Seconds
from gcs.regular_file import open_regular

LAST: Final = "last"
_TAIL_BYTES: Final = 65_536


class State(Enum):
    """How a flight's record stands. BROKEN_OFF: its program was killed, or the machine went down."""

    IN_PROGRESS = "in progress"
    ENDED = "ended"
    BROKEN_OFF = "broken off"
    UNREADABLE = "unreadable"


@dataclass(frozen=True, slots=True)
class RecordedFlight:
    """started_unix_s: seconds since 1970. follows: how often something was followed; None: not known."""

    path: Path
    state: State
    size_bytes: int
    kind: str = ""
    started_unix_s: float = 0.0
    length_s: float | None = None
    vehicle: str | None = None
    follows: int | None = None
    problems: tuple[str, ...] = ()


class _Head(msgspec.Struct):
    t_s: Seconds


def find_flight(text: str, folder: Path) -> Path:
    """The folder of a flight: a path, a name within `folder`, or `last` for the newest there. GcsError for no such."""
    if text == LAST:
        found = max(_started(folder), default=None)
        if found is None:
            raise GcsError(f"{folder}: no flight is recorded there")
        return found[1]
    for path in (Path(text), folder / text):
        if path.is_dir():
            return path
        if path.is_file():
            raise GcsError(f"{path}: is a file; give the folder of the flight")
    raise GcsError(f"{text}: no such flight, neither a folder nor a name in {folder} (see `gcs flights`)")


def _started(folder: Path) -> list[tuple[float, Path]]:
    found = []
    for path in _folders(folder):
        with contextlib.suppress(ManifestError):
            found.append((read_manifest(path).unix_start_s, path))
    return found


def _folders(folder: Path) -> list[Path]:
    try:
        return [path for path in folder.iterdir() if (path / MANIFEST).exists()]
    except OSError:
        return []


def list_flights(folder: Path) -> list[RecordedFlight]:
    """All that are in there, the newest first. GcsError where there is no such folder."""
    if not folder.is_dir():
        raise GcsError(f"{folder}: no such folder")
    return sorted(map(_look_at, _folders(folder)), key=lambda flight: flight.started_unix_s, reverse=True)


def _look_at(path: Path) -> RecordedFlight:
    size = size_bytes(path)
    try:
        manifest = read_manifest(path)
    except ManifestError as error:
        return RecordedFlight(path, State.UNREADABLE, size, problems=(str(error),))
    if is_in_progress(path):
        state = State.IN_PROGRESS
    else:
        state = State.BROKEN_OFF if manifest.ended is None else State.ENDED
    return RecordedFlight(
        path, state, size, manifest.kind, manifest.unix_start_s, _length_s(path, manifest), manifest.vehicle,
        manifest.follows, manifest.problems,
    )  # fmt: skip


def _length_s(path: Path, manifest: Manifest) -> float | None:
    """From the start to the last message; without messages as the wall clock tells."""
    with contextlib.suppress(OSError), open_regular(path / MESSAGES) as file:
        file.seek(max(0, file.seek(0, 2) - _TAIL_BYTES))
        for line in reversed(file.read().splitlines()):
            with contextlib.suppress(msgspec.DecodeError, RecursionError):
                return msgspec.json.decode(line, type=_Head).t_s - manifest.t_start_s
    with contextlib.suppress(ValueError):
        if manifest.ended is not None:
            return (datetime.fromisoformat(manifest.ended) - datetime.fromisoformat(manifest.started)).total_seconds()
    return None

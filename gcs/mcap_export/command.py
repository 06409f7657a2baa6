"""`gcs export FLIGHT`: a recorded flight as an MCAP file."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from functools import partial
from heapq import merge
from operator import itemgetter
from pathlib import Path
from typing import IO, Final

import msgspec

from control.camera import CameraModel
from gcs.cli.progress import shown_progress
from gcs.config import Config, load
from gcs.errors import ConfigError, one_line
from gcs.json_line import json_line
from gcs.mcap_export.topics import FlightTopics
from gcs.mcap_export.video import FilmTopics
from gcs.mcap_export.writer import ExportError, TopicWriter
from gcs.recorder.film_reader import FilmReader
from gcs.recorder.flights import find_flight
from gcs.recorder.folder import in_progress_note
from gcs.recorder.manifest import MANIFEST, Manifest, ManifestError, read_manifest
from gcs.replay.log import FlightLog
from gcs.result_file import result_file

_MCAP: Final = "flight.mcap"

_Due = tuple[float, Callable[[], None]]


class Exported(msgspec.Struct, frozen=True):
    """What was written. topics: number of messages by name; notes: what is missing, in one line each."""

    file: str
    bytes: int
    topics: dict[str, int]
    notes: tuple[str, ...]


def main(args: argparse.Namespace) -> int:
    """The command."""
    folder = find_flight(args.flight, Path(load(None).recorder.folder))
    exported = export_flight(folder, Path(args.mcap) if args.mcap else folder / _MCAP)
    if args.json:
        sys.stdout.write(json_line(exported))
        return 0
    for note in exported.notes:
        sys.stderr.write(f"{one_line(note)}\n")
    size_mb, count = exported.bytes / 1e6, sum(exported.topics.values())
    said = f"{exported.file}: {size_mb:.1f} MB, {count} messages on {len(exported.topics)} topics"
    sys.stdout.write(f"{one_line(said)}\n")
    return 0


def export_flight(folder: Path, path: Path) -> Exported:
    """Write the file, at once or not at all. Raises ReplayError without a flight, ExportError where it cannot be."""
    log = FlightLog(folder)
    if path.suffix.lower() != ".mcap":
        raise ExportError(f"--mcap {path}: the name must end in .mcap")
    try:
        with result_file(path) as file:
            counts, notes = _write(folder, log, file)
    except OSError as error:
        raise ExportError(f"{path}: {(error.strerror or str(error)).lower()}") from error
    return Exported(str(path), path.stat().st_size, counts, tuple(notes))


def _write(folder: Path, log: FlightLog, file: IO[bytes]) -> tuple[dict[str, int], list[str]]:
    notes = in_progress_note(folder)
    manifest = _manifest(folder, notes)
    config = _config(manifest, notes)
    film = FilmReader(folder)
    writer = TopicWriter(file, manifest.unix_s if manifest is not None else lambda t_s: t_s)
    if manifest is not None:
        facts = {**manifest.software, **manifest.machine, "kind": manifest.kind, "started": manifest.started}
        writer.note("flight", facts)
        writer.attach(MANIFEST, "application/json", (folder / MANIFEST).read_bytes(), log.start_s)
    pictures = FilmTopics(writer, film)
    topics = FlightTopics(
        writer, pictures, config.control.follow, _camera(config, film.size or _said_size(manifest), notes)
    )
    entries = shown_progress(log, "export", "messages", len(log))
    flight: Iterator[_Due] = ((entry[0], partial(topics.add, entry)) for entry in entries)
    filmed: Iterator[_Due] = ((packet.t_arrival_s, partial(pictures.add, packet)) for packet in film.packets())
    for _, put in merge(flight, filmed, key=itemgetter(0)):
        put()
    film.close()
    writer.finish()
    notes += [note for note in (film.problem, pictures.note) if note is not None]
    notes += [f"{log.damaged} messages cannot be read"] if log.damaged else []
    return dict(writer.counts), notes


def _manifest(folder: Path, notes: list[str]) -> Manifest | None:
    try:
        return read_manifest(folder)
    except ManifestError as error:
        notes.append(f"{error}; times are the flight's own, and the camera is taken for the usual one")
        return None


def _config(manifest: Manifest | None, notes: list[str]) -> Config:
    try:
        return manifest.configuration if manifest is not None else Config()
    except ManifestError as error:
        notes.append(f"{error}; the defaults are used")
        return Config()


def _said_size(manifest: Manifest | None) -> tuple[int, int] | None:
    video = manifest.video if manifest is not None else None
    return (video.width_px, video.height_px) if video is not None else None


def _camera(config: Config, size: tuple[int, int] | None, notes: list[str]) -> CameraModel | None:
    """None where its pictures have no known size."""
    try:
        return config.camera.model(*size) if size is not None else None
    except ConfigError as error:
        notes.append(str(error))
        return None

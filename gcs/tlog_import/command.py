"""`gcs import TLOG`: a telemetry log of another station, with a video of it, as a flight to replay and report."""

from __future__ import annotations

import argparse
import contextlib
import shutil
import sys
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Final

import msgspec

from gcs.config import Config, load
from gcs.errors import one_line, printable
from gcs.json_line import json_line
from gcs.recorder.facts import machine, software, utc
from gcs.recorder.flight_recorder import MESSAGES, TLOG
from gcs.recorder.folder import FlightFolder, given_folder, refused
from gcs.recorder.manifest import Manifest, VideoFacts, plain, write_manifest
from gcs.recorder.message_log import MessageLog
from gcs.tlog_import.flight import ImportedFlight
from gcs.tlog_import.survey import Survey, survey
from gcs.tlog_import.tlog import Tlog, TlogError
from gcs.tlog_import.video import ImportedVideo

_SLACK_S: Final = 60.0  # a video may begin and end a little outside of the log
_WRITE_S: Final = 60.0
_MOST_OFFSET_S: Final = 1e9


class Imported(msgspec.Struct, frozen=True):
    """What was made of which log and video. offset_s: the video begins so long after the log, told_by whom."""

    folder: str
    vehicle: str
    started: str
    log_s: float
    messages: int
    video_s: float | None
    pictures: int
    offset_s: float | None
    told_by: str | None
    notes: tuple[str, ...]


def main(args: argparse.Namespace) -> int:
    """The command."""
    path = Path(args.tlog)
    out = Path(args.out) if args.out else Path(load(None).recorder.folder) / f"import-{path.stem}"
    imported = import_flight(path, out, args.video, args.offset, args.system)
    if args.json:
        sys.stdout.write(json_line(imported))
        return 0
    for note in imported.notes:
        sys.stderr.write(f"{one_line(note)}\n")
    sys.stdout.write("\n".join(map(printable, _lines(imported))) + "\n")
    return 0


def import_flight(
    path: Path, out: Path, video: str | None = None, offset_s: float | None = None, system_id: int | None = None
) -> Imported:
    """Make the folder `out`, whole or not at all. Raises TlogError, VideoError, FolderError.

    offset_s: the video begins so long after the log; None: as its creation time says, else both end together.
    """
    if offset_s is not None and video is None:
        raise TlogError("--offset: only with --video")
    if offset_s is not None and not abs(offset_s) <= _MOST_OFFSET_S:
        raise TlogError(f"--offset {offset_s:g}: at most {_MOST_OFFSET_S:g} s either way")
    tlog = Tlog(path)
    with contextlib.closing(tlog):
        found = survey(tlog, system_id)
        filmed = ImportedVideo(Path(video)) if video is not None else None
        folder = given_folder(out)
        try:
            imported = _write(folder, tlog, found, filmed, offset_s)
        except OSError as error:
            folder.discard()
            raise refused(out, error) from error
        except BaseException:
            folder.discard()
            raise
        folder.close()
    return imported


def _write(
    folder: FlightFolder, tlog: Tlog, found: Survey, video: ImportedVideo | None, offset_s: float | None
) -> Imported:
    told_by = None
    if video is not None:
        offset_s, told_by = (offset_s, "--offset") if offset_s is not None else _offset(found, video)
    start_s = max(0.0, -(offset_s or 0.0))  # of the log on a clock that begins with whichever is first
    path = folder.path
    write_manifest(path, _manifest(tlog.path, found, video, start_s))
    shown = video.film(path, start_s + (offset_s or 0.0)) if video is not None else []
    shutil.copyfile(tlog.path, path / TLOG)
    log = MessageLog(path / MESSAGES, wait_when_full=True)
    flight = ImportedFlight(log, Config(), found.vehicle.system_id)
    said = f"imported from {tlog.path.name}: another station flew it, nothing here was decided by this one"
    try:
        flight.run(tlog, found, start_s, shown, said)
    finally:
        log.close(_WRITE_S)
    if log.problem is not None:
        raise TlogError(log.problem)
    notes = tuple(_notes(tlog, flight, video, found, offset_s))
    manifest = _manifest(tlog.path, found, video, start_s)
    ended_unix_s = found.unix_start_s + found.span_s
    write_manifest(path, msgspec.structs.replace(manifest, ended=utc(ended_unix_s), follows=0, problems=notes))
    return Imported(
        folder=str(path), vehicle=str(found.vehicle), started=manifest.started, log_s=found.span_s,
        messages=flight.received, video_s=video.span_s if video is not None else None, pictures=len(shown),
        offset_s=offset_s, told_by=told_by, notes=notes,
    )  # fmt: skip


def _offset(found: Survey, video: ImportedVideo) -> tuple[float, str]:
    """Where the video most likely belongs, and what tells so."""
    if video.created_unix_s is not None:
        offset_s = video.created_unix_s - found.unix_start_s
        if offset_s >= -_SLACK_S and offset_s + video.span_s <= found.span_s + _SLACK_S:
            return offset_s, "its creation time"
    return found.span_s - video.span_s, "both ending together"


def _manifest(path: Path, found: Survey, video: ImportedVideo | None, start_s: float) -> Manifest:
    config = replace(Config(), vehicle=replace(Config().vehicle, system_id=found.vehicle.system_id))
    return Manifest(
        kind="import", started=utc(found.unix_start_s), t_start_s=start_s, unix_start_s=found.unix_start_s,
        software=software(), machine=machine(), config=plain(config), vehicle=f"{found.vehicle}, {path.name}",
        watermark="IMPORTED",
        video=VideoFacts(video.path.name, *video.size, video.fps) if video is not None else None,
    )  # fmt: skip


def _notes(
    tlog: Tlog,
    flight: ImportedFlight,
    video: ImportedVideo | None,
    found: Survey,
    offset_s: float | None,
) -> list[str]:
    notes = []
    if tlog.skipped_bytes:
        notes.append(f"{tlog.path}: {tlog.skipped_bytes} bytes between its frames were left out")
    if tlog.clock_steps:
        notes.append(f"{tlog.path}: the clock was set {tlog.clock_steps} times meanwhile; times go by the last setting")
    if flight.unknown:
        notes.append(f"{tlog.path}: {flight.unknown} frames of kinds that are not known here were left out")
    if flight.damaged:
        notes.append(f"{tlog.path}: {flight.damaged} frames with a wrong checksum were left out")
    if video is not None and offset_s is not None and not -video.span_s <= offset_s <= found.span_s:
        notes.append(f"{video.path}: lies outside of the log by this offset: no picture has telemetry")
    return notes


def _lines(imported: Imported) -> list[str]:
    began = datetime.fromisoformat(imported.started).astimezone().isoformat(" ", "seconds")
    lines = [f"log    {began}, {imported.log_s:.1f} s, {imported.vehicle}, {imported.messages} messages"]
    if imported.video_s is not None and imported.offset_s is not None:
        after = f"{abs(imported.offset_s):.1f} s {'after' if imported.offset_s >= 0 else 'before'} the log"
        lines.append(
            f"video  {imported.video_s:.1f} s, {imported.pictures} pictures, begins {after}, by {imported.told_by}"
        )
        if imported.told_by != "--offset":
            lines.append("       if that is not so, import again with --offset S")
    return [*lines, f"gcs replay {imported.folder}, gcs report {imported.folder}"]

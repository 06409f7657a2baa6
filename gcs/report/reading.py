"""A flight folder read once: its messages, its manifest, and what is wrong with them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Final, TypeVar

from gcs.config import Config
from gcs.recorder.flight_recorder import MESSAGES, TLOG
from gcs.recorder.folder import in_progress_note
from gcs.recorder.manifest import MANIFEST, Manifest, ManifestError, read_manifest
from gcs.regular_file import open_regular
from gcs.replay.film import Film
from gcs.replay.log import FlightLog, ReplayError
from gcs.report.figures import IMPORT, Provenance, Report
from gcs.report.provenance import provenance_of
from gcs.report.tally import Tally
from gcs.report.words import verdict_of

Progress = Callable[[str], None]
T = TypeVar("T")
_TLOG_STAMP_BYTES: Final = 8  # microseconds since 1970, before each message
_EVERY: Final = 2000  # messages


class Reading:
    """A flight folder, read once. config: as it was flown with, None where that is not known."""

    def __init__(self, folder: Path, progress: Progress = lambda _: None) -> None:
        if not folder.is_dir():
            raise ReplayError(f"{folder}: no such folder")
        self.log = FlightLog(folder)
        manifest, problems = _manifest(folder)
        self.config: Config | None = None
        is_import = manifest is not None and manifest.kind == IMPORT
        if manifest is not None and not is_import:  # what is configured here was not flown with there
            try:
                self.config = manifest.configuration
            except ManifestError as error:
                problems.append(str(error))
        config = self.config or Config()
        self.tally = Tally(self.log.start_s, config.control.follow, is_import, _mount_yaw_rad(config))
        for entry in _counted(self.log, len(self.log), progress):
            self.tally.add(entry)
        self.tally.finish(self.log.span_s)
        problems += _problems(folder, manifest, self.log, self.tally)
        self.report = self._report(folder, manifest, problems)

    def _report(self, folder: Path, manifest: Manifest | None, problems: list[str]) -> Report:
        tally, span_s = self.tally, self.log.span_s
        battery = tally.battery
        report = Report(
            folder=str(folder),
            began=_began(folder, span_s, manifest, self.log.start_s),
            lasted_s=span_s,
            autopilot=tally.autopilot,
            frames=tally.frames,
            fps=tally.frames / span_s if span_s > 0 else 0.0,
            timeline=tuple(tally.events),
            following=tally.follow.following(),
            latency_ms=tally.latency.percentiles(),
            limits_s={one.name: one.total_s for one in tally.follow.limits()},
            link=tally.link.link,
            audit=tally.link.audit,
            longest_pause_s=tally.longest_pause_s,
            problems=tuple(problems),
            phases=tuple(tally.phases),
            follows=tuple(tally.follow.follows()),
            losses=tuple(one.loss for one in tally.follow.missing),
            clipped=tuple(tally.follow.limits()),
            orders=tuple(tally.orders),
            refusals=tuple(tally.refusals),
            said=tuple(tally.said),
            battery_frac=(battery.first / 100, battery.last / 100) if battery else None,
            provenance=Provenance() if manifest is None else provenance_of(manifest),
        )
        return replace(report, verdict=verdict_of(report, self.config))


def _manifest(folder: Path) -> tuple[Manifest | None, list[str]]:
    """And what is wrong with it; a flight can be without one."""
    if not (folder / MANIFEST).exists():
        return None, []
    try:
        return read_manifest(folder), []
    except ManifestError as error:
        return None, [str(error)]


def _mount_yaw_rad(config: Config) -> float:
    """As `Config.camera_model` has it, which needs the size of the pictures too."""
    return 0.0 if config.gimbal.enabled else math.radians(config.camera.mount_rpy_deg[2])


def _counted(entries: Iterable[T], whole: int, progress: Progress) -> Iterator[T]:
    for number, entry in enumerate(entries):
        if number % _EVERY == 0:
            progress(f"messages, {number / max(whole, 1):.0%}")
        yield entry


def _began(folder: Path, span_s: float, manifest: Manifest | None, start_s: float) -> str:
    """By the manifest, else the raw log's stamps, else by when the messages were last written to."""
    began_s = (folder / MESSAGES).stat().st_mtime - span_s
    if manifest is not None:
        began_s = manifest.unix_s(start_s)
    else:
        try:
            with open_regular(folder / TLOG) as file:
                stamp = file.read(_TLOG_STAMP_BYTES)
            if len(stamp) == _TLOG_STAMP_BYTES:
                began_s = int.from_bytes(stamp, "big") / 1e6
        except OSError:
            pass
    try:
        return datetime.fromtimestamp(began_s).astimezone().isoformat(" ", "seconds")
    except (ValueError, OverflowError, OSError):  # a damaged stamp
        return "at an unknown time"


def _problems(folder: Path, manifest: Manifest | None, log: FlightLog, tally: Tally) -> list[str]:
    found = [f"{text} ({count} frames)" for text, count in tally.problems.most_common()]
    still = in_progress_note(folder)
    found += still
    if manifest is not None:
        found += manifest.problems
        if manifest.ended is None and not still:
            found.append("the flight was not ended in order")
    if log.dropped:
        found.append(f"{log.dropped} messages were not written: the disk or the processor was too slow")
    if log.damaged:
        found.append(f"{log.damaged} messages cannot be read")
    if log.astray:
        found.append(f"{log.astray} messages have a time that cannot be: they are told at that of the one before")
    if log.is_cut and not still:
        found.append("the last message is cut off: the program did not end in order")
    if tally.ends_engaged and not still:
        found.append("the record ends in the middle of a follow: the video, or the program, ended there")
    if tally.left_out:
        found.append(f"{tally.left_out} more lines of the timeline are left out here")
    if tally.phases_left_out:
        found.append(f"{tally.phases_left_out} later changes of state are not drawn in the band of states")
    film = Film(folder)
    film.close()
    is_missed = film.is_there or manifest is None or manifest.kind != IMPORT
    return [*found, film.problem] if film.problem is not None and is_missed else found

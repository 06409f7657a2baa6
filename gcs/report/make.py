"""`gcs report FLIGHT`: what a recorded flight came to, on one screen."""

from __future__ import annotations

import argparse
import sys
from datetime import datetime
from pathlib import Path

import msgspec

from gcs.dryrun.record import ANNOTATED
from gcs.recorder.flight_recorder import MESSAGES, TLOG
from gcs.replay.film import VIDEO
from gcs.replay.log import FlightLog, ReplayError
from gcs.report.figures import Report
from gcs.report.tally import Tally
from gcs.report.text import text_of

_TLOG_STAMP_BYTES = 8  # microseconds since 1970, before each message


def main(args: argparse.Namespace) -> int:
    """The command."""
    report = report_of(Path(args.flight))
    if args.json:
        sys.stdout.write(msgspec.json.encode(report).decode() + "\n")
    else:
        sys.stdout.write(text_of(report) + "\n")
    return 0


def report_of(folder: Path) -> Report:
    """One pass over the messages. Raises ReplayError where there are none."""
    if not folder.is_dir():
        raise ReplayError(f"{folder}: no such folder")
    log = FlightLog(folder)
    tally = Tally(log.start_s)
    for entry in log:
        tally.add(entry)
    return Report(
        folder=str(folder),
        began=_began(folder, log.span_s),
        lasted_s=log.span_s,
        autopilot=tally.autopilot,
        frames=tally.frames,
        fps=tally.frames / log.span_s if log.span_s > 0 else 0.0,
        timeline=tuple(tally.events),
        following=tally.following(),
        latency_ms=tally.latency_ms(),
        limits_s=dict(tally.limits_s.most_common()),
        link=tally.link,
        audit=tally.audit,
        longest_pause_s=tally.longest_pause_s,
        problems=tuple(_problems(folder, log, tally)),
    )


def _began(folder: Path, span_s: float) -> str:
    """By the raw log's stamps, else by when the messages were last written to."""
    began_s = (folder / MESSAGES).stat().st_mtime - span_s
    try:
        with (folder / TLOG).open("rb") as file:
            stamp = file.read(_TLOG_STAMP_BYTES)
        if len(stamp) == _TLOG_STAMP_BYTES:
            began_s = int.from_bytes(stamp, "big") / 1e6
    except OSError:
        pass
    try:
        return datetime.fromtimestamp(began_s).astimezone().isoformat(" ", "seconds")
    except (ValueError, OverflowError, OSError):  # a damaged stamp
        return "at an unknown time"


def _problems(folder: Path, log: FlightLog, tally: Tally) -> list[str]:
    found = [f"{text} ({count} frames)" for text, count in tally.problems.most_common()]
    if log.dropped:
        found.append(f"{log.dropped} messages were not written: the disk or the processor was too slow")
    if log.damaged:
        found.append(f"{log.damaged} messages cannot be read")
    if log.is_cut:
        found.append("the last message is cut off: the program did not end in order")
    if tally.ends_engaged:
        found.append("the record ends in the middle of a follow: the program did not end in order")
    if not any((folder / name).exists() for name in (VIDEO, ANNOTATED)):
        found.append("there is no film")
    return found

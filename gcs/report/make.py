"""`gcs report FLIGHT`: what a recorded flight came to, as one page for a browser and on one screen of text."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Final

from gcs.config import RecorderConfig
from gcs.errors import GcsError, one_line
from gcs.json_line import json_line
from gcs.operator.terminal_screen import Screen
from gcs.recorder.flights import find_flight
from gcs.replay.film import Film
from gcs.report.figures import Report
from gcs.report.page import page_of
from gcs.report.pictures import pictures_of
from gcs.report.reading import Progress, Reading
from gcs.report.text import text_of
from gcs.result_file import result_file

PAGE: Final = "report.html"
_QUIET_S: Final = 2.0


class ReportError(GcsError):
    """A page that cannot be written; names the file."""


def main(args: argparse.Namespace) -> int:
    """The command."""
    folder = find_flight(args.flight, Path(RecorderConfig().folder))
    if args.json:
        sys.stdout.write(json_line(report_of(folder)))
        return 0
    screen = Screen(sys.stderr)
    report, path = make(folder, None if args.html is None else Path(args.html), _patient(screen))
    screen.block([])
    sys.stdout.write(f"{text_of(report)}\n\n  page: {one_line(path)}\n")
    return 0


def report_of(folder: Path) -> Report:
    """One pass over the messages. Raises ReplayError where there are none."""
    return Reading(folder).report


def write_report(folder: Path, path: Path | None = None) -> Path:
    """The page of a flight; path: report.html in its folder if not said. Raises ReplayError, ReportError."""
    return make(folder, path)[1]


def make(folder: Path, path: Path | None = None, progress: Progress = lambda _: None) -> tuple[Report, Path]:
    """Report and page. progress: told now and then how far it is."""
    target = path or folder / PAGE
    if target.suffix.lower() != ".html":
        raise ReportError(f"--html {target}: the name must end in .html")
    reading = Reading(folder, progress)
    progress("pictures")
    film = Film(folder, reading.log)
    try:
        pictures = pictures_of(reading.tally.follow, film) if film.is_there else {}
    finally:
        film.close()
    text = page_of(reading.report, reading.tally, pictures, reading.config)
    try:
        with result_file(target) as file:
            file.write(text.encode("utf-8", "replace"))
    except OSError as error:
        raise ReportError(f"{target}: {(error.strerror or str(error)).lower()}") from error
    return reading.report, target


def _patient(screen: Screen) -> Progress:
    """A live line from the third second on."""
    begun_s = time.monotonic()

    def told(text: str) -> None:
        if time.monotonic() - begun_s > _QUIET_S:
            screen.live(f"report: {text} ...")

    return told

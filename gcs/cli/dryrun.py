"""`gcs dry-run`: arguments to options, a progress bar, the summary on the screen."""

from __future__ import annotations

import argparse
import functools
import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from types import TracebackType

import msgspec
from tqdm import tqdm

from control.camera import CameraModel
from gcs.cli.args_operator import with_operator_arguments
from gcs.config import load
from gcs.dryrun.batch import Options, run
from gcs.dryrun.output import Summary
from gcs.errors import EXIT_INTERRUPTED, GcsError, VideoError, one_line
from gcs.selection import parse_box
from gcs.tracking import make_tracker
from sitl_mocks import sequences


class UsageError(GcsError):
    """Arguments that do not go together."""


def main(args: argparse.Namespace) -> int:
    """Run, print, and fail if the video broke on the way."""
    options = options_of(args)
    if args.page:
        return _in_page(options, args)
    with Bar() as bar:
        summary = run(options, tracker_factory=functools.partial(make_tracker, say=_tell), progress=bar.update)
    show(summary, as_json=args.json)
    if summary.problem is not None:
        raise VideoError(summary.problem)
    return EXIT_INTERRUPTED if summary.interrupted else 0


def _tell(text: str) -> None:
    print(one_line(text), file=sys.stderr, flush=True)


def _in_page(options: Options, args: argparse.Namespace) -> int:
    from gcs.dryrun import page  # the page's parts are for this alone

    if args.select:
        raise UsageError("--select opens a window of its own: with --page draw the box in the page")
    out = sys.stderr if args.json else sys.stdout
    options = replace(options, config=with_operator_arguments(options.config, args))
    summary = page.run(options, lambda text: print(one_line(text), file=out, flush=True))
    if summary is not None and args.json:
        show(summary, as_json=True)
    return 0


def options_of(args: argparse.Namespace) -> Options:
    """Raises GcsError, ConfigError or the sequences' ValueError for arguments that cannot be used."""
    config = load(args.config, args.profile)
    if args.weights is not None:
        config = replace(config, tracker=replace(config.tracker, weights=args.weights))
    if args.seconds is not None and not (math.isfinite(args.seconds) and args.seconds > 0):
        raise UsageError(f"--seconds {args.seconds:g}: must be more than 0")
    options = Options(
        video=args.video or config.video.url or "",
        out=Path(args.out or Path(config.recorder.folder) / "dry-run"),
        config=config,
        box=None if args.box is None else parse_box(args.box),
        truth=None if args.boxes is None else Path(args.boxes),
        telemetry=None if args.telemetry is None else Path(args.telemetry),
        select=args.select,
        limit_s=args.seconds,
        annotate=not args.no_video and config.recorder.video,
    )
    if args.sample is not None:
        if args.video is not None:
            raise UsageError(f"give either --sample or {args.video}, not both")
        return of_sample(options, args.sample)
    if not options.video:
        raise UsageError("no video: give a file, an image folder, a stream, camera:N, or --sample")
    return options


def of_sample(options: Options, name: str) -> Options:
    """The same for a shipped sequence, with its own boxes, telemetry and lens."""
    known = sequences.names()
    name = name or next(iter(known), "")
    if name not in known:
        raise UsageError(f"--sample {name}: no such sequence; there are: {', '.join(known) or 'none'}")
    lens = json.loads(sequences.path(name, ".json").read_text())["lens"]
    camera = CameraModel.from_hfov(
        lens["width_px"],
        lens["height_px"],
        lens["hfov_rad"],
        tuple(lens["distortion"]),
        (0.0, lens["mount_pitch_rad"], 0.0),
    )
    return replace(
        options,
        video=str(sequences.path(name)),
        truth=options.truth or sequences.path(name, ".txt"),
        telemetry=options.telemetry or sequences.path(name, ".jsonl"),
        camera=camera,
    )


def show(summary: Summary, *, as_json: bool) -> None:
    """The summary on stdout: one JSON line, or one line of text and what should be known about it."""
    if as_json:
        print(msgspec.json.encode(summary).decode())
        return
    print(one_line(summary.line()))
    if summary.assumed_distance_m is not None:
        print(
            f"note: the distance cannot be known from this recording; "
            f"setpoints assume {summary.assumed_distance_m:g} m at the start"
        )
    for note in summary.notes:
        print(one_line(f"note: {note}"))


class Bar:
    """A progress bar on stderr that appears with the first frame, so that errors before it stand alone."""

    def __init__(self) -> None:
        self._bar: tqdm | None = None

    def __enter__(self) -> Bar:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.close()

    def update(self, done: int, total: int | None) -> None:
        """`done` frames so far, of `total` if that is known."""
        if self._bar is None:
            self._bar = tqdm(total=total, unit="frame", desc="dry run", dynamic_ncols=True)
        self._bar.update(done - self._bar.n)

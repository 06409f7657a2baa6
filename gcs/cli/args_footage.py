"""Arguments of the commands that work on video and records: dry-run, replay, report."""

from __future__ import annotations

import argparse

from gcs.cli.args_operator import add_port
from gcs.cli.parser import Commands, add_command


def add(commands: Commands) -> None:
    """The commands."""
    _add_dry_run(commands)
    _add_replay(commands)
    _add_report(commands)


def _add_dry_run(commands: Commands) -> None:
    p = add_command(
        commands, "dry-run", "your video through the whole chain, with no vehicle",
        handler="gcs.cli.dryrun:main",
        more="There is no link at all, so nothing can move; what would have been sent is written down.",
        examples=(
            "gcs dry-run --sample",
            "gcs dry-run video.mp4 --box 300,200,48,36",
            "gcs dry-run video.mp4 --page           # draw the box in a browser",
            "gcs dry-run rtsp://192.168.1.10/main --page --seconds 60",
        ),
    )  # fmt: skip
    p.add_argument("video", nargs="?", metavar="VIDEO", help="file, image folder, stream or camera:N")
    p.add_argument("--sample", nargs="?", const="", metavar="NAME", help="a recorded sequence that ships with gcs")
    p.add_argument("--box", metavar="x,y,w,h", help="target in the first frame, px")
    p.add_argument("--select", action="store_true", help="draw the box on the first frame in a window")
    p.add_argument("--page", action="store_true", help="steer and watch in a browser, as in a flight")
    add_port(p)
    p.add_argument("--boxes", metavar="FILE", help="ground truth (x,y,w,h per frame) to score against")
    p.add_argument("--telemetry", metavar="FILE", help="attitude recorded with the video (JSON lines)")
    p.add_argument("--weights", metavar="NAME|FILE", help="default: compact")
    p.add_argument("--config", metavar="FILE", help="configuration (YAML)")
    p.add_argument("--profile", metavar="NAME", help="a ready-made configuration (see `gcs config --profiles`)")
    p.add_argument("--out", metavar="DIR", help="where the results go (default: out/dry-run)")
    p.add_argument("--seconds", type=float, metavar="S", help="stop after this much video")
    p.add_argument("--no-video", action="store_true", help="write no annotated.mp4")
    p.add_argument("--json", action="store_true", help="the summary as one JSON line on stdout")


def _add_replay(commands: Commands) -> None:
    p = add_command(
        commands, "replay", "a recorded flight again, as its operator saw it",
        handler="gcs.replay.play:main",
        more="Nothing is sent anywhere.",
        examples=(
            "gcs replay out/run",
            "gcs replay out/demo --speed 4",
            "gcs replay out/run --no-page",
        ),
    )  # fmt: skip
    p.add_argument("flight", metavar="FLIGHT", help="the folder of the flight, as out/run")
    p.add_argument("--speed", type=float, default=1.0, metavar="X", help="times faster than it was (default: 1)")
    p.add_argument("--page", action=argparse.BooleanOptionalAction, default=True, help="show it in a browser (default)")
    add_port(p)


def _add_report(commands: Commands) -> None:
    p = add_command(
        commands, "report", "what a recorded flight came to",
        handler="gcs.report.make:main",
        examples=("gcs report out/run", "gcs report out/demo --json"),
    )  # fmt: skip
    p.add_argument("flight", metavar="FLIGHT", help="the folder of the flight, as out/run")
    p.add_argument("--json", action="store_true", help="one JSON line")

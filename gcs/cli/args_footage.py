"""Arguments of the commands that work on video and records: dry-run, replay, report, flights, export, import."""

from __future__ import annotations

import argparse

from gcs.cli.args_operator import add_port
from gcs.cli.parser import Commands, Parser, add_command


def add(commands: Commands) -> None:
    """The commands."""
    _add_dry_run(commands)
    _add_replay(commands)
    _add_report(commands)
    _add_flights(commands)
    _add_export(commands)
    _add_import(commands)


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
    p.add_argument("--weights", metavar="NAME|FILE", help="default: what is best here")
    p.add_argument("--config", metavar="FILE", help="configuration (YAML)")
    p.add_argument("--profile", metavar="NAME", help="a ready-made configuration (see `gcs config --profiles`)")
    p.add_argument("--out", metavar="DIR", help="where the results go (default: out/dry-run)")
    p.add_argument("--seconds", type=float, metavar="S", help="stop after this much video")
    p.add_argument("--no-video", action="store_true", help="write no annotated.mp4")
    p.add_argument("--json", action="store_true", help="the summary as one JSON line on stdout")


def _add_replay(commands: Commands) -> None:
    p = add_command(
        commands, "replay", "a recorded flight again, as its operator saw it",
        handler="gcs.cli.replay:main",
        more="Nothing is sent anywhere. --verify flies it again on its own clock instead of showing it, and compares "
        "every box, state and setpoint.",
        examples=(
            "gcs replay last",
            "gcs replay out/demo --speed 4",
            "gcs replay last --film annotated.mp4",
            "gcs replay out/demo --verify            # exit status 1 where anything differs",
            "gcs replay out/demo --verify --from control",
            "gcs replay out/demo --with my.yaml      # what another tuning would have done",
        ),
    )  # fmt: skip
    _add_flight(p)
    p.add_argument("--speed", type=float, default=1.0, metavar="X", help="times faster than it was (default: 1)")
    p.add_argument("--page", action=argparse.BooleanOptionalAction, default=True, help="show it in a browser (default)")
    add_port(p)
    instead = p.add_mutually_exclusive_group()
    instead.add_argument("--film", metavar="FILE", help="write a film with the overlay drawn in instead of showing it")
    instead.add_argument("--verify", action="store_true", help="fly it again and compare, to the last bit")
    p.add_argument(
        "--from", dest="from_stage", choices=("tracker", "control"), metavar="STAGE",
        help="what is flown again: from `tracker` on (default), or from `control` on, with the recorded boxes",
    )  # fmt: skip
    instead.add_argument(
        "--with", dest="with_config", metavar="CONFIG", help="fly it again with this configuration (YAML)"
    )
    p.add_argument("--json", action="store_true", help="JSON lines on stdout (with --no-page, --verify or --with)")


def _add_report(commands: Commands) -> None:
    p = add_command(
        commands, "report", "what a recorded flight came to",
        handler="gcs.report.make:main",
        more="Writes one page for a browser that needs nothing else, and sums it up here.",
        examples=("gcs report last", "gcs report out/demo --html demo.html", "gcs report out/demo --json"),
    )  # fmt: skip
    _add_flight(p)
    p.add_argument("--html", metavar="FILE", help="where the page goes (default: report.html in its folder)")
    p.add_argument("--json", action="store_true", help="one JSON line, and no page")


def _add_flights(commands: Commands) -> None:
    p = add_command(
        commands, "flights", "list the recorded flights",
        handler="gcs.cli.flights:main",
        more="The newest first.",
        examples=("gcs flights", "gcs flights --folder /media/card --json"),
    )  # fmt: skip
    p.add_argument("--folder", metavar="DIR", help="where they are (default: out)")
    p.add_argument("--json", action="store_true", help="one JSON line for each")


def _add_export(commands: Commands) -> None:
    p = add_command(
        commands, "export", "a recorded flight for Foxglove (MCAP)",
        handler="gcs.mcap_export.command:main",
        more="Video, boxes, states, setpoints, paths and telemetry, each with its schema. Needs the extra `mcap`.",
        examples=("gcs export last", "gcs export out/demo --mcap demo.mcap"),
    )  # fmt: skip
    _add_flight(p)
    p.add_argument("--mcap", metavar="FILE", help="what to write (default: flight.mcap in its folder)")
    p.add_argument("--json", action="store_true", help="what was written, as one JSON line")


def _add_import(commands: Commands) -> None:
    p = add_command(
        commands, "import", "a telemetry log of another station, with its video, as a flight",
        handler="gcs.tlog_import.command:main",
        more="For replay, report and export; what no station of ours flew has no boxes and no setpoints.",
        examples=(
            "gcs import 2026-05-03.tlog",
            "gcs import mission.tlog --video DJI_0042.MP4 --offset 12.5",
            "gcs import both.tlog --system 2 --out out/second",
        ),
    )  # fmt: skip
    p.add_argument("tlog", metavar="TLOG", help="of MAVProxy, Mission Planner, QGroundControl or gcs")
    p.add_argument("--video", metavar="FILE", help="filmed during it")
    p.add_argument(
        "--offset", type=float, metavar="S",
        help="the video begins so long after the log does (default: by its creation time, else both end together)",
    )  # fmt: skip
    p.add_argument("--system", type=int, metavar="N", help="the vehicle, where there are several (MAVLink system id)")
    p.add_argument("--out", metavar="DIR", help="folder of the flight (default: one of its own in out)")
    p.add_argument("--json", action="store_true", help="what was found, as one JSON line")


def _add_flight(p: Parser) -> None:
    p.add_argument("flight", metavar="FLIGHT", help="a flight's folder, its name, or `last`")

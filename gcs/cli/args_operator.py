"""What a command line says of page, terminal and outputs, over what the configuration says."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

from gcs.errors import GcsError

if TYPE_CHECKING:  # `gcs --help` needs no configuration
    from gcs.config import Config

_MOST_PORT = 65535


def add_operator(parser: argparse._ActionsContainer) -> None:
    """The arguments of commands that fly."""
    add = parser.add_argument
    add("--no-page", action="store_true", help="no page for a browser")
    add_port(parser)
    add("--headless", action="store_true", help="no page; the terminal shows everything, full screen")
    add("--plain", action="store_true", help="the terminal shows plain lines, never full screen")
    add("--rtsp", type=int, metavar="PORT", help="serve the video at rtsp://HOST:PORT/live (extra `video`)")
    text = "be a MAVLink camera for QGroundControl there: udpout://127.0.0.1:14550"
    add("--qgc", metavar="URL", help=text)


def add_port(parser: argparse._ActionsContainer) -> None:
    """--port of the page."""
    parser.add_argument("--port", type=int, metavar="N", help="of the page (default: 8870; 0: any free one)")


def with_operator_arguments(config: Config, args: argparse.Namespace) -> Config:
    """The configuration with what was given; a command that lacks one of the arguments leaves it as configured.

    GcsError for a port that cannot be.
    """
    page, camera, video = config.page, config.mavlink_camera, config.video_out
    port, rtsp = _port(args, "port", low=0), _port(args, "rtsp", low=1)
    if getattr(args, "no_page", False) or getattr(args, "headless", False):
        page = replace(page, enabled=False)
    if port is not None:
        page = replace(page, port=port)
    if rtsp is not None:
        video = replace(video, rtsp_port=rtsp)
    if getattr(args, "qgc", None):
        camera = replace(camera, url=args.qgc)
    return replace(config, page=page, mavlink_camera=camera, video_out=video)


def _port(args: argparse.Namespace, name: str, *, low: int) -> int | None:
    value: int | None = getattr(args, name, None)
    if value is not None and not low <= value <= _MOST_PORT:
        raise GcsError(f"--{name} {value}: must be from {low} to {_MOST_PORT}")
    return value

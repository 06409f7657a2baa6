"""`gcs run`: the arguments, and the page first: it answers before what a flight needs is even imported."""

from __future__ import annotations

import argparse
import asyncio
import importlib
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.backend import Backend
from gcs.cli.args_operator import with_operator_arguments
from gcs.cli.args_vehicle import with_arguments
from gcs.clock import MonotonicClock
from gcs.config import AutopilotChoice, Config, FollowChoice, load
from gcs.errors import ConfigError, VideoError
from gcs.operator.displays import Displays
from gcs.operator.terminal_screen import Screen

if TYPE_CHECKING:  # OpenCV is for later
    from tracker.box import Box


@dataclass(frozen=True, slots=True)
class RunOptions:
    """What `gcs run` was asked for; out: the record's folder, None makes one. box: selected at once.

    plain: the terminal shows lines only. json: the state as JSON lines on stdout.
    """

    video: str
    vehicle: str
    config: Config
    out: Path | None = None
    box: Box | None = None
    plain: bool = False
    json: bool = False


def main(args: argparse.Namespace) -> int:
    """The command: arguments over configuration."""
    config = with_operator_arguments(load(args.config, args.profile), args)
    vehicle = with_arguments(config.vehicle, args)
    if args.autopilot is not None:
        vehicle = replace(vehicle, autopilot=AutopilotChoice(args.autopilot))
    video = args.video or config.video.url
    if not video:
        raise VideoError("no video: give --video URL, or video.url in the configuration")
    if vehicle.backend is Backend.FOLLOW_TARGET:
        _check_own_mode(config)
    options = RunOptions(
        video=video,
        vehicle=vehicle.url,
        config=replace(config, vehicle=vehicle),
        out=Path(args.out) if args.out else None,
        box=None if args.box is None else _box(args.box),
        plain=args.plain or args.json,
        json=args.json,
    )
    return run(options, Screen(sys.stderr if args.json else sys.stdout))


def _box(text: str) -> Box:
    from gcs.selection import parse_box

    return parse_box(text)


def _check_own_mode(config: Config) -> None:
    """ConfigError for what the vehicle's own follow mode decides, or does, itself."""
    if config.follow.mode is not FollowChoice.FOLLOW:
        mode = config.follow.mode.value
        raise ConfigError(f"the vehicle's own follow mode (--backend follow-target) cannot do follow.mode {mode}")
    if config.gimbal.enabled:
        raise ConfigError("the vehicle's own follow mode points the gimbal itself: gimbal.enabled must be false")


def run(options: RunOptions, screen: Screen) -> int:
    """Fly until the operator quits or a signal comes; the exit status. GcsError for what cannot be flown."""
    return asyncio.run(_run(options, screen))


async def _run(options: RunOptions, screen: Screen) -> int:
    config, clock = options.config, MonotonicClock()
    displays = Displays(config, clock, screen.say)
    await displays.open()
    try:
        if displays.url is not None:
            screen.say(f"page: {displays.url}")
        displays.starting("loading the program")
        app = await asyncio.to_thread(importlib.import_module, "gcs.app")
        await app.run_shown(options, screen, displays, clock)
    finally:
        await displays.close()
        screen.end()  # an error stands on a line of its own
    return 0

"""`gcs replay FLIGHT`: a recorded flight again, in the page, as lines or as a film. Nothing is sent anywhere."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import sys
from dataclasses import replace
from pathlib import Path

from gcs.cli.args_operator import with_operator_arguments
from gcs.clock import Clock, MonotonicClock
from gcs.config import Config
from gcs.errors import GcsError, one_line
from gcs.operator.displays import Displays
from gcs.operator.playback import SPEEDS
from gcs.operator.terminal_screen import Screen
from gcs.recorder.flights import find_flight
from gcs.replay.annotate import write_film
from gcs.replay.lines import play_json, play_lines
from gcs.replay.player import Delivered, End, Player
from gcs.replay.recorded import Recorded, open_recorded
from gcs.replay.station import ReplayStation
from gcs.replay.timeline import glance
from gcs.signals import signals


def main(args: argparse.Namespace) -> int:
    """The command."""
    speed = float(args.speed)
    if not SPEEDS[0] <= speed <= SPEEDS[1]:
        raise GcsError(f"--speed {speed:g}: must be from {SPEEDS[0]:g} to {SPEEDS[1]:g}")
    recorded = open_recorded(find_flight(args.flight, Path(Config().recorder.folder)))
    screen, clock = Screen(sys.stdout), MonotonicClock()
    with contextlib.closing(recorded.film):
        if args.film is not None:
            screen.say(one_line(write_film(recorded, Path(args.film))))
            return 0
        with contextlib.suppress(KeyboardInterrupt):
            if args.page:
                config = with_operator_arguments(Config(), args)
                asyncio.run(_play_page(recorded, speed, screen, clock, config))
            else:
                _play_lines(recorded, speed, screen, clock, as_json=args.json)
    return 0


def _play_lines(recorded: Recorded, speed: float, screen: Screen, clock: Clock, *, as_json: bool) -> None:
    if as_json:
        play_json(recorded, speed, screen.say, clock)
        return
    for problem in recorded.problems:
        screen.say(one_line(problem))
    play_lines(recorded, speed, screen.say, clock)


async def _play_page(recorded: Recorded, speed: float, screen: Screen, clock: Clock, config: Config) -> None:
    displays = Displays(replace(config, page=replace(config.page, enabled=True)), clock, screen.say)
    loop, stopping = asyncio.get_running_loop(), asyncio.Event()
    station = ReplayStation(recorded, glance(recorded), displays.say)

    def deliver(delivered: Delivered) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(take, delivered)

    def take(delivered: Delivered) -> None:
        station.deliver(delivered)
        if isinstance(delivered, End):
            displays.say("the recording has ended; Ctrl-C leaves")

    player = station.player = Player(recorded, clock, speed, deliver)
    with signals(stopping.set):
        await displays.open()
        try:
            screen.say(f"page: {displays.url}")
            for problem in recorded.problems:
                displays.say(problem)
            async with displays.serve(station):
                player.start()
                await stopping.wait()
        finally:
            await asyncio.to_thread(player.close)
            await displays.close()

"""`gcs replay FLIGHT`: a recorded flight again, in the page or as lines in the terminal. Nothing is sent anywhere."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import sys
from dataclasses import replace
from pathlib import Path
from typing import Final

from gcs.cli.args_operator import with_operator_arguments
from gcs.clock import Clock, MonotonicClock
from gcs.config import Config
from gcs.errors import GcsError
from gcs.operator.displays import Displays
from gcs.operator.terminal import Screen
from gcs.replay.film import Film
from gcs.replay.log import FlightLog, ReplayError
from gcs.replay.player import Moment, Player
from gcs.replay.station import ReplayStation
from gcs.signals import signals

_LEAST_SPEED, _MOST_SPEED = 0.1, 20.0
_LINE_S: Final = 5.0  # of the flight, between lines where nothing changes


def main(args: argparse.Namespace) -> int:
    """The command."""
    speed = float(args.speed)
    if not _LEAST_SPEED <= speed <= _MOST_SPEED:
        raise GcsError(f"--speed {speed:g}: must be from {_LEAST_SPEED:g} to {_MOST_SPEED:g}")
    screen, clock = Screen(sys.stdout), MonotonicClock()
    log, film = open_flight(Path(args.flight))
    if not args.page:
        play_lines(log, film, speed, screen, clock)
        return 0
    config = with_operator_arguments(Config(), args)
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_play_page(log, film, speed, screen, clock, config))
    return 0


def open_flight(folder: Path) -> tuple[FlightLog, Film]:
    """Messages and film of a flight's folder. Raises ReplayError without messages."""
    if not folder.is_dir():
        raise ReplayError(f"{folder}: no such folder")
    log = FlightLog(folder)
    return log, Film(folder, log)


def station_of(film: Film) -> ReplayStation:
    """For the pictures of this film, or those that stand in for it."""
    return ReplayStation(film.size, drawn_in=film.is_annotated)


def play_lines(log: FlightLog, film: Film, speed: float, screen: Screen, clock: Clock) -> None:
    """Each change as a line with its time, and one now and then."""
    if film.problem is not None:
        screen.say(film.problem)
    station = station_of(film)
    player = Player(log, film, clock, speed, lambda moment: None)
    said, due_s = "", log.start_s
    for moment in player.moments(pictures=False):
        station.took(moment)
        headline = station.status().headline
        if headline != said or moment.t_s >= due_s:
            said, due_s = headline, moment.t_s + _LINE_S
            screen.say(f"{moment.t_s - log.start_s:7.1f} s  {station.status_line()}")
    player.close()


async def _play_page(log: FlightLog, film: Film, speed: float, screen: Screen, clock: Clock, config: Config) -> None:
    displays = Displays(replace(config, page=replace(config.page, enabled=True)), clock, screen.say)
    loop, stopping = asyncio.get_running_loop(), asyncio.Event()
    station = station_of(film)

    def deliver(moment: Moment | None) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(take, moment)

    def take(moment: Moment | None) -> None:
        if moment is not None:
            station.took(moment)
        else:
            station.has_ended = True
            displays.say("the recording has ended; Ctrl-C leaves")

    player = Player(log, film, clock, speed, deliver)
    with signals(stopping.set):
        await displays.open()
        try:
            screen.say(f"page: {displays.url}")
            if film.problem is not None:
                displays.say(film.problem)
            async with displays.serve(station):
                player.start()
                await stopping.wait()
        finally:
            await asyncio.to_thread(player.close)
            await displays.close()

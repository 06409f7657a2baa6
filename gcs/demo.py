"""`gcs demo`: the whole station against a mocked vehicle in a rendered world, judged by the simulator's truth."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from gcs.app import fly, make_flight, open_link, open_live
from gcs.cli.args_operator import with_operator_arguments
from gcs.clock import MonotonicClock
from gcs.config import Config, GimbalConfig, load
from gcs.demo_operator import DemoOperator
from gcs.demo_plot import plot
from gcs.demo_report import Score, read_truth, score, table
from gcs.demo_simulator import TRUTH, Simulator, simulator
from gcs.errors import GcsError
from gcs.flight import Flight
from gcs.flight_station import FlightStation
from gcs.operator.config import PageConfig
from gcs.operator.displays import Displays
from gcs.operator.terminal import Screen
from gcs.recorder.folder import FlightFolder, demo_folder
from gcs.recorder.recording import recording
from gcs.signals import signals
from gcs.tracking import BoxTracker, make_tracker

_LIVE_S: Final = 0.5
_LINE_S: Final = 5.0  # where the output is no terminal
FENCE_M: Final = 500.0


_QUIET: Final = replace(Config(), page=PageConfig(enabled=False))


@dataclass(frozen=True, slots=True)
class DemoOptions:
    """seconds: of following, once confirmed. out: folder for everything that is left behind. config: to begin with."""

    out: Path
    seconds: float = 60.0
    scenario: str = "demo"
    personality: str = "px4"
    seed: int | None = None
    gimbal: bool = False
    config: Config = _QUIET


@dataclass(frozen=True, slots=True)
class Outcome:
    """What the flight came to; interrupted: by the operator, before its end."""

    score: Score
    has_landed: bool
    interrupted: bool

    @property
    def exit_code(self) -> int:
        """0 only for a flight that followed, landed, and did nothing unsafe."""
        flown = self.score.bearing_rms_deg is not None and self.has_landed and not self.interrupted
        return 0 if flown and self.score.unsafe == 0 else 1


def main(args: argparse.Namespace) -> int:
    """The command: the live line while it flies, then a table or one JSON line."""
    seconds = 60.0 if args.seconds is None else args.seconds
    if not (math.isfinite(seconds) and 1.0 <= seconds <= 600.0):
        raise GcsError(f"--seconds {seconds:g}: must be from 1 to 600")
    options = DemoOptions(
        out=Path(args.out or "out/demo"),
        seconds=seconds,
        scenario=args.scenario or "demo",
        personality=args.personality or "px4",
        seed=args.seed,
        gimbal=args.gimbal,
        config=with_operator_arguments(load(None, args.profile), args),
    )
    screen = Screen(sys.stderr if args.json else sys.stdout)
    outcome = demo(options, screen)
    if args.json:
        sys.stdout.write(outcome.score.to_json() + "\n")
    else:
        screen.say(f"{table(outcome.score)}\n  see {options.out}/plot.png, and again: `gcs replay {options.out}`")
    return outcome.exit_code


def demo(options: DemoOptions, screen: Screen, make: Callable[[Config], BoxTracker] | None = None) -> Outcome:
    """Fly and judge. make: the tracker, for tests that bring their own."""
    make = make or (lambda config: make_tracker(config.tracker, screen.say))
    with contextlib.closing(demo_folder(options.out)) as folder:
        return asyncio.run(_demo(options, screen, folder, make))


async def _demo(
    options: DemoOptions, screen: Screen, kept: FlightFolder, make: Callable[[Config], BoxTracker]
) -> Outcome:
    folder = kept.path
    tracker = await asyncio.to_thread(make, options.config)
    screen.say(f"simulator: {options.personality}, scenario {options.scenario}")
    async with simulator(
        folder,
        scenario=options.scenario,
        personality=options.personality,
        seed=options.seed,
        extra=("--gimbal",) if options.gimbal else (),
    ) as world:
        operator, interrupted = await _fly(options, world, screen, tracker, kept)
    truth = read_truth(folder / TRUTH)
    spans = operator.spans()
    monitor = world.monitor()
    result = score(
        truth, operator.frames, spans,
        max_setpoint_gap_s=float(monitor["max_setpoint_gap_s"]), unsafe=int(monitor["unsafe"]),
        half_view_rad=math.radians(world.camera.hfov_deg) / 2,
    )  # fmt: skip
    for reason in monitor["reasons"]:
        screen.say(f"UNSAFE {reason['rule']}: {reason['text']}")
    plot(folder / "plot.png", truth, spans, f"{options.scenario}, {options.personality}")
    (folder / "summary.json").write_text(json.dumps(json.loads(result.to_json()), indent=1) + "\n")
    return Outcome(result, operator.has_landed, interrupted)


async def _fly(
    options: DemoOptions, world: Simulator, screen: Screen, tracker: BoxTracker, folder: FlightFolder
) -> tuple[DemoOperator, bool]:
    clock, config = MonotonicClock(), demo_config(world, options.config)
    displays = Displays(config, clock, screen.say)
    await _open(displays, screen)
    try:
        async with recording(folder, config, clock, displays.say) as kept:
            source = await asyncio.to_thread(open_live, world.video_url, config, kept.film)
            try:
                await kept.begin("demo", source, world.vehicle_url, seed=options.seed, watermark="SIM")
                await kept.tracked_by(tracker)
                async with open_link(world.vehicle_url, config, clock, kept.record) as link:
                    displays.say(f"vehicle: {link.telemetry.vehicle}")
                    flight = make_flight(link, source, tracker, config, clock, displays.say, kept.record)
                    operator = DemoOperator(flight, world, clock, displays.say, options.seconds, options.seed or 0)
                    return operator, await _watched(flight, operator, displays, screen)
            finally:
                screen.end()
                await asyncio.to_thread(source.close)
    finally:
        await displays.close()


async def _watched(flight: Flight, operator: DemoOperator, displays: Displays, screen: Screen) -> bool:
    """Fly; whether the person at the keyboard ended it."""
    interrupts: list[bool] = []

    def interrupt() -> None:
        interrupts.append(True)
        flight.stop()

    flight.watchers = (*flight.watchers, operator)
    with contextlib.closing(FlightStation(flight, "SIM")) as station:
        async with displays.serve(station):
            with signals(interrupt):
                await fly(flight, operator.run(), _show(flight, screen))
    return bool(interrupts)


async def _open(displays: Displays, screen: Screen) -> None:
    """A page to look on by; where its port is taken, there is none."""
    try:
        await displays.open()
    except GcsError as error:
        screen.say(f"no page: {error}")
    if displays.url is not None:
        screen.say(f"watch it at {displays.url}")


async def _show(flight: Flight, screen: Screen) -> None:
    """The live line, or a line now and then where there is no terminal."""
    while True:
        if screen.is_terminal:
            screen.live(flight.status_line())
        else:
            screen.say(flight.status_line())
        await asyncio.sleep(_LIVE_S if screen.is_terminal else _LINE_S)


def demo_config(world: Simulator, config: Config) -> Config:
    """The same with the simulator's lens, and a fence as wide as its roads are long."""
    fence = replace(config.control.limits.fence, radius_m=FENCE_M)
    limits = replace(config.control.limits, fence=fence)
    return replace(
        config,
        camera=world.camera,
        gimbal=GimbalConfig(enabled=world.gimbal),
        vehicle=replace(config.vehicle, url=world.vehicle_url, takeoff_height_m=world.height_m),
        control=replace(config.control, limits=limits),
    )

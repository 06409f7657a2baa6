"""`gcs run`: opens everything a flight needs, flies, and closes it in order."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import gc
import signal
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from control.modes import FollowMode
from gcs.autopilot.actions import VehicleActions
from gcs.autopilot.mode_control import ModeControl
from gcs.backend import Backend
from gcs.cli_vehicle import with_arguments
from gcs.clock import Clock, MonotonicClock
from gcs.config import AutopilotChoice, Config, FollowChoice, load
from gcs.dryrun_output import prepare_folder
from gcs.errors import ConfigError, GcsError, VehicleError, VideoError
from gcs.flight import Flight, Link
from gcs.flight_control import Wanted
from gcs.flight_orders import Orders
from gcs.flight_record import TLOG, FlightRecorder
from gcs.flight_view import Watcher
from gcs.link_meters import LinkFigures
from gcs.operator.orders import Select
from gcs.operator.terminal import Screen, TerminalOperator, perform
from gcs.selection import parse_box
from gcs.signing import open_signing, security
from gcs.telemetry import Telemetry
from gcs.tracking import BoxTracker, make_tracker
from gcs.video import VideoSource, open_source
from gcs.wire import Wire
from tracker.box import Box


@dataclass(frozen=True, slots=True)
class RunOptions:
    """What `gcs run` was asked for; out: a folder for the record, None keeps none. box: selected at once."""

    video: str
    vehicle: str
    config: Config
    out: Path | None = None
    box: Box | None = None


def main(args: argparse.Namespace) -> int:
    """The command: arguments over configuration."""
    config = load(args.config)
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
        out=Path(args.out) if args.out else Path(config.recorder.folder) / "run",
        box=None if args.box is None else parse_box(args.box),
    )
    return run(options, Screen(sys.stdout))


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
    source = await asyncio.to_thread(open_live, options.video, config)
    try:
        screen.say(f"video: {source.size[0]}x{source.size[1]} px from {source.name}")
        tracker = await asyncio.to_thread(make_tracker, config.tracker)
        folder = prepare_folder(options.out) if options.out is not None else None
        async with open_link(options.vehicle, config, clock, folder) as link:
            screen.say(f"vehicle: {link.telemetry.vehicle}, {security(link.wire.signing, link.wire.vehicle_signs)}")
            with recorder(folder, config, source, screen.say, figures=link.wire.figures) as watchers:
                flight = make_flight(link, source, tracker, config, clock, screen.say, watchers)
                orders = Orders(flight)
                operator = TerminalOperator(orders, screen)
                with signals(flight.stop):
                    await fly(flight, operator.run(), *_preselect(orders, options.box, screen))
        return 0
    finally:
        await asyncio.to_thread(source.close)


def _preselect(orders: Orders, box: Box | None, screen: Screen) -> tuple[asyncio.Future[None], ...]:
    """--box: select at the first picture."""
    return () if box is None else (perform(orders.perform(Select(box)), screen.say),)  # type: ignore[return-value]


def open_live(address: str, config: Config) -> VideoSource:
    """The video of a flight; recorded video is refused, because what it shows is not where the vehicle is."""
    source = open_source(address, glass_delay_s=config.camera.assumed_glass_delay_s, reconnect=config.video.reconnect)
    if not source.is_live:
        source.close()
        raise VideoError(f"{address} is recorded video, which can never fly a vehicle; use `gcs dryrun`")
    return source


@contextlib.asynccontextmanager
async def open_link(url: str, config: Config, clock: Clock, folder: Path | None) -> AsyncIterator[Link]:
    """The vehicle at this address, heard and with telemetry; closed in order afterwards."""
    tlog = None
    if folder is not None and config.recorder.tlog:
        tlog = folder / TLOG
        tlog.unlink(missing_ok=True)
    signing = await asyncio.to_thread(open_signing, config.vehicle.signing_key, clock)
    system_id = config.vehicle.system_id
    wire = await Wire.open(
        url, clock=clock, tlog=tlog, vehicle_system_id=system_id, signing=signing, backend=config.vehicle.backend
    )
    try:
        telemetry = Telemetry(wire, clock)
        vehicle = await wire.wait_vehicle(config.vehicle.timeout_s)
        wanted = config.vehicle.autopilot
        if wanted is not AutopilotChoice.AUTO and _choice(vehicle.autopilot.name) is not wanted:
            raise VehicleError(f"{url}: the configuration wants {wanted.value}, but this is {vehicle}")
        actions = await VehicleActions.attach(wire, telemetry, clock)
        try:
            yield Link(wire, telemetry, ModeControl(wire, telemetry, clock), actions)
        finally:
            await actions.close()
            telemetry.close()
    finally:
        await wire.close()


def _choice(name: str) -> AutopilotChoice:
    return AutopilotChoice.PX4 if name == "PX4" else AutopilotChoice.ARDUPILOT


@contextlib.contextmanager
def recorder(
    folder: Path | None,
    config: Config,
    source: VideoSource,
    say: Callable[[str], None],
    watermark: str | None = None,
    figures: Callable[[float], LinkFigures] | None = None,
) -> Iterator[tuple[Watcher, ...]]:
    """The flight's record as a watcher; nothing without a folder."""
    if folder is None:
        yield ()
        return
    record = FlightRecorder(folder, config.recorder, source.size, source.fps, watermark, figures)
    try:
        yield (record,)
    finally:
        for problem in record.close():
            say(f"record: {problem}")


def make_flight(
    link: Link,
    source: VideoSource,
    tracker: BoxTracker,
    config: Config,
    clock: Clock,
    say: Callable[[str], None],
    watchers: tuple[Watcher, ...] = (),
) -> Flight:
    """A flight as configured, not yet running."""
    flight = Flight(link, source, tracker, config, clock, say=say, watchers=watchers)
    follow = config.follow
    mode = FollowMode(follow.mode.value)
    flight.control.wanted = Wanted(mode, standoff_m=follow.standoff_m, distance_m=follow.distance_m)
    return flight


async def fly(flight: Flight, *beside: object) -> None:
    """Run the flight; of several faults at once the first that has a line for the user is raised."""
    # What is loaded by now (PyTorch, MAVSDK) stays: a full collection over it would hold up the control task.
    gc.collect()
    gc.freeze()
    try:
        await flight.run(*beside)  # type: ignore[arg-type]
    except BaseExceptionGroup as group:
        known = group.subgroup((GcsError, ValueError))
        raise first_of(known if known is not None else group) from None
    finally:
        gc.unfreeze()


def first_of(group: BaseExceptionGroup[BaseException]) -> BaseException:
    """The first single exception in a tree of them."""
    error = group.exceptions[0]
    return first_of(error) if isinstance(error, BaseExceptionGroup) else error


@contextlib.contextmanager
def signals(stop: Callable[[], None]) -> Iterator[None]:
    """Ctrl-C and SIGTERM end the flight in order, however often they come; afterwards they are as before."""
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop)
    try:
        yield
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.remove_signal_handler(number)

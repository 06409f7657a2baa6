"""Opens everything a flight needs, flies, and closes it in order. `gcs.launch` begins it."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import importlib
import sys
from collections.abc import AsyncIterator, Callable
from pathlib import Path

from control.modes import FollowMode
from gcs.autopilot.actions import VehicleActions
from gcs.autopilot.mode_control import ModeControl
from gcs.clock import Clock
from gcs.config import AutopilotChoice, Config
from gcs.errors import GcsError, VehicleError, VideoError
from gcs.flight import Flight, Link
from gcs.flight_camera import run_camera
from gcs.flight_control import Wanted
from gcs.flight_station import FlightStation
from gcs.launch import RunOptions
from gcs.operator.displays import Displays, stream_url
from gcs.operator.json_lines import write_lines
from gcs.operator.orders import Select
from gcs.operator.terminal import Screen, TerminalOperator, perform
from gcs.recorder.flight_recorder import FlightRecorder
from gcs.recorder.folder import FlightFolder, given_folder, new_folder
from gcs.recorder.recording import Recording, recording
from gcs.signals import signals
from gcs.signing import open_signing, security
from gcs.telemetry import Telemetry
from gcs.tracking import BoxTracker, make_tracker
from gcs.video import VideoSource, open_source
from gcs.video.frame import redact
from gcs.video.tap import Tap
from gcs.wire import Wire
from tracker.box import Box


async def run_shown(options: RunOptions, screen: Screen, displays: Displays, clock: Clock) -> None:
    """Fly until the operator quits or a signal comes. GcsError for what cannot be flown."""
    config, lines = options.config, Screen(sys.stdout)  # of JSON
    folder = await asyncio.to_thread(_folder, options)
    async with recording(folder, config, clock, displays.say) as kept:
        _starting(f"opening the video {redact(options.video)}", screen, displays)
        source = await asyncio.to_thread(open_live, options.video, config, kept.film)
        try:
            screen.say(f"video: {source.size[0]}x{source.size[1]} px from {source.name}")
            await _fly_shown(options, source, kept, screen, displays, clock, lines)
        finally:
            lines.end()
            await asyncio.to_thread(source.close)
    screen.say(f"recorded in {kept.path}: `gcs replay {kept.path}`, `gcs report {kept.path}`")


def _folder(options: RunOptions) -> FlightFolder:
    return new_folder(Path(options.config.recorder.folder)) if options.out is None else given_folder(options.out)


def _starting(text: str, screen: Screen, displays: Displays) -> None:
    screen.live(f"{text} ...")
    displays.starting(text)


async def _fly_shown(
    options: RunOptions,
    source: VideoSource,
    kept: Recording,
    screen: Screen,
    displays: Displays,
    clock: Clock,
    lines: Screen,
) -> None:
    config = options.config
    _starting(f"loading the tracker, waiting for the vehicle at {options.vehicle}", screen, displays)
    # Side by side: the one keeps a processor busy, the other mostly waits.
    loop = asyncio.get_running_loop()
    loading = asyncio.create_task(
        asyncio.to_thread(_load, config, lambda text: loop.call_soon_threadsafe(displays.say, text))
    )
    # What went wrong with it is raised where it is awaited; where the link fails first, that is what is told.
    loading.add_done_callback(lambda task: task.cancelled() or task.exception())
    await displays.prepare()
    watermark = "SIM" if config.vehicle.simulated else None
    await kept.begin("run", source, options.vehicle, watermark=watermark)
    async with open_link(options.vehicle, config, clock, kept.record) as link:
        vehicle, secured = link.telemetry.vehicle, security(link.wire.signing, link.wire.vehicle_signs)
        displays.say(f"vehicle: {vehicle}, {secured}")
        if not loading.done():
            _starting("loading the tracker", screen, displays)
        tracker = await loading
        await kept.tracked_by(tracker)
        flight = make_flight(link, source, tracker, config, clock, displays.say, kept.record)
        station = FlightStation(flight, watermark)
        operator = TerminalOperator(station, screen, lease=displays.lease, clock=clock, plain=options.plain)
        beside = [operator.run(), *_preselect(station, options.box, displays.say)]
        if options.json:
            beside.append(write_lines(station, displays.lease, clock, lines))
        async with displays.serve(station) as video:
            camera = run_camera(
                flight, station, displays.lease, displays.say,
                stream_url=None if video is None else stream_url(video, config.video_out),
                definition_url=displays.definition_url,
            )  # fmt: skip
            with signals(flight.stop), contextlib.closing(station):
                await fly(flight, *beside, camera)


def _load(config: Config, say: Callable[[str], object]) -> BoxTracker:
    """In a thread: SciPy's second is spent here too, not on the loop when the first filter is made."""
    importlib.import_module("filterpy.kalman")
    return make_tracker(config.tracker, say)


def _preselect(station: FlightStation, box: Box | None, say: Callable[[str], None]) -> tuple[asyncio.Future[None], ...]:
    """--box: select at the first picture."""
    return () if box is None else (perform(station.perform(Select(box)), say),)  # type: ignore[return-value]


def open_live(address: str, config: Config, tap: Tap | None = None) -> VideoSource:
    """The video of a flight; recorded video is refused, because what it shows is not where the vehicle is."""
    delay_s, reconnect = config.camera.assumed_glass_delay_s, config.video.reconnect
    source = open_source(address, glass_delay_s=delay_s, reconnect=reconnect, tap=tap)
    if not source.is_live:
        source.close()
        raise VideoError(f"{address} is recorded video, which can never fly a vehicle; use `gcs dry-run`")
    return source


@contextlib.asynccontextmanager
async def open_link(
    url: str, config: Config, clock: Clock, record: FlightRecorder | None = None
) -> AsyncIterator[Link]:
    """The vehicle at this address, heard and with telemetry; closed in order afterwards."""
    tlog = None if record is None else record.tlog
    signing = await asyncio.to_thread(open_signing, config.vehicle.signing_key, clock)
    system_id = config.vehicle.system_id
    wire = await Wire.open(
        url, clock=clock, tlog=tlog, vehicle_system_id=system_id, signing=signing, backend=config.vehicle.backend
    )
    try:
        if record is not None:
            wire.subscribe(record.received)
            record.figures = wire.figures
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


def make_flight(
    link: Link,
    source: VideoSource,
    tracker: BoxTracker,
    config: Config,
    clock: Clock,
    say: Callable[[str], None],
    record: FlightRecorder | None = None,
) -> Flight:
    """A flight as configured, not yet running."""
    watchers = () if record is None else (record,)
    flight = Flight(link, source, tracker, config, clock, say=say, watchers=watchers, journal=record)
    if record is not None:
        flight.film, flight.record_troubles = record.film, record.troubles
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

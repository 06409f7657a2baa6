"""`gcs dry-run VIDEO --page`: the operator's page on a desk with nothing attached; the page's is the only socket."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import Callable
from dataclasses import replace

from control.estimator import TargetEstimator
from gcs.clock import Clock, MonotonicClock
from gcs.config import Config
from gcs.config import TrackerConfig as TrackerChoice
from gcs.dryrun.batch import Options, first_box
from gcs.dryrun.flight import DryRunFlight
from gcs.dryrun.output import Summary, prepare_folder
from gcs.dryrun.pace import PacedSource, Place
from gcs.dryrun.record import DryRunRecord
from gcs.dryrun.station import DryRunStation
from gcs.errors import GcsError
from gcs.operator.config import MavlinkCameraConfig, VideoOutConfig
from gcs.operator.displays import Displays
from gcs.poses import RecordedPoses
from gcs.signals import signals
from gcs.tracking import BoxTracker, make_tracker
from gcs.video import VideoSource, open_source
from tracker.eval.sequences import read_boxes

_FPS = 20.0
Say = Callable[[str], None]


def run(
    options: Options, say: Say, tracker_factory: Callable[[TrackerChoice], BoxTracker] | None = None
) -> Summary | None:
    """Until Ctrl-C; the summary of the newest pass through the video, None if it never played.

    Raises GcsError, one line, when there is nothing to run.
    """
    make = tracker_factory or functools.partial(make_tracker, say=say)
    return asyncio.run(_run(options, say, make))


async def _run(options: Options, say: Say, tracker_factory: Callable[[TrackerChoice], BoxTracker]) -> Summary | None:
    clock, config = MonotonicClock(), _only_the_page(options.config)
    prepare_folder(options.out)
    displays = Displays(config, clock, say)
    await displays.open()
    try:
        if displays.url is not None:
            say(f"page: {displays.url}")
        poses = RecordedPoses.load(options.telemetry) if options.telemetry else None
        displays.starting("opening the video")
        source = await asyncio.to_thread(open_paced, options, clock)
        try:
            return await _desk(source, options, config, clock, displays, poses, tracker_factory)
        finally:
            await asyncio.to_thread(source.close)
    finally:
        await displays.close()


async def _desk(
    source: VideoSource,
    options: Options,
    config: Config,
    clock: Clock,
    displays: Displays,
    poses: RecordedPoses | None,
    tracker_factory: Callable[[TrackerChoice], BoxTracker],
) -> Summary | None:
    displays.starting("loading the tracker")
    tracker = await asyncio.to_thread(_load, config, tracker_factory)
    passes = Passes(options, source, displays.say)
    camera = options.camera or config.camera.model(*source.size)
    flight = DryRunFlight(source, tracker, camera, config, clock, poses=poses, went=passes.went)
    passes.follow(flight)
    truth = read_boxes(options.truth) if options.truth is not None else None
    given = options.box is not None or truth is not None
    station = DryRunStation(flight, first_box(options, truth, source.size) if given else None)
    with signals(flight.stop):
        async with displays.serve(station):
            await _fly(flight, station, displays.say, None if flight.place is Place.START else options.limit_s)
        station.close()
        return await passes.end()


def _load(config: Config, tracker_factory: Callable[[TrackerChoice], BoxTracker]) -> BoxTracker:
    TargetEstimator(config.control.estimator)  # what it imports takes a second, which the page would stand still
    return tracker_factory(config.tracker)


async def _fly(flight: DryRunFlight, station: DryRunStation, say: Say, limit_s: float | None) -> None:
    """Until it is stopped, or the operator quits, or a live video has run for limit_s."""
    if limit_s is not None:
        asyncio.get_running_loop().call_later(limit_s, flight.stop)
    async with asyncio.TaskGroup() as group:
        selecting = group.create_task(_begin(station, say))
        await flight.run()
        selecting.cancel()


async def _begin(station: DryRunStation, say: Say) -> None:
    """--box, or the first of --boxes, on the first picture."""
    try:
        say(await station.begin())
    except GcsError as error:
        say(str(error))


def open_paced(options: Options, clock: Clock) -> VideoSource:
    """The video as it comes: recorded video at its own pace. Raises VideoError."""

    def opened() -> VideoSource:
        delay_s = options.config.camera.assumed_glass_delay_s
        return open_source(options.video, glass_delay_s=delay_s, fps=options.config.video.fps)

    source = opened()
    if source.is_live:
        return source
    source.close()
    return PacedSource(opened, clock, options.limit_s)


def _only_the_page(config: Config) -> Config:
    page = replace(config.page, enabled=True)
    return replace(config, page=page, video_out=VideoOutConfig(), mavlink_camera=MavlinkCameraConfig())


class Passes:
    """Each time the video plays it is recorded anew; the results are written when it ends."""

    def __init__(self, options: Options, source: VideoSource, say: Say) -> None:
        self._options, self._source, self._say = options, source, say
        self._flight: DryRunFlight | None = None
        self._record: DryRunRecord | None = None
        self._writing: asyncio.Task[None] | None = None
        self._summary: Summary | None = None

    def follow(self, flight: DryRunFlight) -> None:
        """The flight whose passes they are; a live video plays already."""
        self._flight = flight
        if flight.place is Place.PLAYING:
            self.went(Place.PLAYING)

    def went(self, place: Place) -> None:
        """The flight has come to this place in the video."""
        if self._flight is None:
            return
        if self._record is not None:
            self._finish(self._flight, self._record)
        if place is Place.PLAYING and (self._writing is None or self._writing.done()):
            self._begin(self._flight)

    def _begin(self, flight: DryRunFlight) -> None:
        options, source = self._options, self._source
        self._record = DryRunRecord(
            options.out, options.config.recorder, source.size, source.fps or _FPS,
            video=source.name, annotate=options.annotate, assumed=lambda: flight.distance_was_assumed,
        )  # fmt: skip
        flight.watchers = (*flight.watchers, self._record)

    def _finish(self, flight: DryRunFlight, record: DryRunRecord) -> None:
        flight.watchers = tuple(each for each in flight.watchers if each is not record)
        self._record = None
        self._writing = asyncio.get_running_loop().create_task(self._write(record))

    async def _write(self, record: DryRunRecord) -> None:
        try:
            self._summary = await asyncio.to_thread(record.finish, self._source.problem)
        except GcsError as error:
            self._say(str(error))
            return
        self._say(self._summary.line())
        if self._summary.problem is not None:
            self._say(self._summary.problem)

    async def end(self) -> Summary | None:
        """Write what is open; the summary of the newest pass."""
        self.went(Place.END)
        if self._writing is not None:
            await self._writing
        return self._summary

"""A dry run that an operator steers: the flight's own decisions on a video, and no vehicle to tell them to.

As `gcs.flight.Flight` to orders and displays, but there is no link, and none is imported.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from control.attitude import AttitudeBuffer
from control.camera import CameraModel
from control.gate import TICK_S
from control.modes import FollowMode, ground_distance_m
from control.types import VehicleState
from gcs.clock import Clock
from gcs.config import Config
from gcs.dryrun.pace import FilmFrame, PacedSource, Place
from gcs.dryrun.rehearsal import ASSUMED_DISTANCE_M, Pose
from gcs.dryrun.vehicle import ImaginedVehicle, NoVehicle
from gcs.flight_control import Act, FollowControl, Tick
from gcs.flight_view import Sighting, Status, Watcher, make_status, predicted_box
from gcs.flight_vision import Seen, Vision
from gcs.frame_rate import FrameRate
from gcs.latency_budget import BudgetDisplay
from gcs.link_health import LinkHealth
from gcs.next import Next
from gcs.poses import RecordedPoses
from gcs.recorder.events import Journal, NoJournal
from gcs.recorder.film import FilmSwitch
from gcs.tracking import BoxTracker
from gcs.video import VideoSource

_ATTITUDE_S: Final = 2.0  # of it known at the start, as on a link that has been open for a while
WAITING: Final = "draw a box to start the video"
READY: Final = "confirm to start the video"
ENDED: Final = "the video has ended: Drop starts again"


@dataclass(frozen=True, slots=True)
class NoOutput:
    """Where the decisions of a dry run go."""

    decides: str = ""
    label: str = ""


class _Telemetry:
    """What the imagined vehicle tells."""

    def __init__(self, vehicle: ImaginedVehicle, clock: Clock) -> None:
        self._vehicle, self._clock = vehicle, clock

    def vehicle_state(self) -> VehicleState:
        return self._vehicle.state(self._clock.now_s())


@dataclass(frozen=True, slots=True)
class _Link:
    telemetry: _Telemetry
    modes: NoVehicle
    actions: NoVehicle


class DryRunFlight:
    """One operator, one video, several passes through it."""

    def __init__(
        self,
        source: VideoSource,
        tracker: BoxTracker,
        camera: CameraModel,
        config: Config,
        clock: Clock,
        *,
        poses: RecordedPoses | None = None,
        went: Callable[[Place], None] = lambda place: None,
    ) -> None:
        """poses: of the vehicle, by video time. went: told of each place in the video that was come to."""
        self.camera, self.config, self.clock = camera, _placed(config), clock
        self.vehicle = ImaginedVehicle(config.vehicle.takeoff_height_m)
        self.auditor = nobody = NoVehicle()
        self.link = _Link(_Telemetry(self.vehicle, clock), nobody, nobody)
        self.output, self.gimbal, self.film = NoOutput(), None, FilmSwitch()
        self.vision = Vision(source, tracker, clock, self._deliver)
        self.typed_distance_m = config.follow.distance_m
        self.distance_was_assumed = False
        self.tick: Tick | None = None
        self.seen: Seen | None = None
        self.watchers: tuple[Watcher, ...] = ()
        self.journal: Journal = NoJournal()
        self.place = Place.START if isinstance(source, PacedSource) else Place.PLAYING
        self._source, self._poses, self._went = source, poses, went
        self._budgets, self._rate = BudgetDisplay(), FrameRate()
        self._ticked: Next[Tick] = Next()
        self._looked: Next[Seen] = Next()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stopping = asyncio.Event()
        self._begin()

    def _begin(self) -> None:
        """Nothing is known of any target."""
        self._attitude = AttitudeBuffer()
        self.vehicle.pose = self._poses.at(0.0) if self._poses is not None else Pose()
        now_s = self.clock.now_s()
        for step in range(round(_ATTITUDE_S / TICK_S), 0, -1):
            self._attitude.add(now_s - step * TICK_S, *self.vehicle.pose.attitude_rpy_rad)
        self.control = FollowControl(self.config.control, self.camera, self._attitude)
        follow = self.config.follow
        self.control.wanted = replace(
            self.control.wanted, mode=FollowMode(follow.mode.value), standoff_m=follow.standoff_m
        )

    # -- running ------------------------------------------------------------------------------------------

    async def run(self) -> None:
        """Until `stop`."""
        self._loop = asyncio.get_running_loop()
        self.vision.start()
        try:
            await self._control()
        finally:
            await asyncio.to_thread(self.vision.close)

    def stop(self) -> None:
        """End it."""
        self._stopping.set()

    async def _control(self) -> None:
        """The 20 Hz loop."""
        due_s = self.clock.now_s()
        while not self._stopping.is_set():
            now_s = self.clock.now_s()
            self.step(now_s)
            due_s = due_s + TICK_S if due_s + TICK_S > now_s else now_s + TICK_S
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._stopping.wait(), max(due_s - self.clock.now_s(), 0.0))

    def step(self, now_s: float) -> Tick:
        """One tick: decide, and let the imagined vehicle take up the mode."""
        if self._poses is not None:
            self.vehicle.pose = self._poses.at(self._video_s(now_s))
        self._attitude.add(now_s, *self.vehicle.pose.attitude_rpy_rad)
        vehicle = self.vehicle.state(now_s)
        if not self.control.is_engaged:
            self._tell_distance(now_s, vehicle)
        self.tick = tick = self.control.tick(now_s, vehicle, LinkHealth(one_way_s=0.0))
        self.vehicle.obey(tick.output.action)
        if tick.budget is not None:
            self._budgets.note(now_s, tick.budget)
        for watcher in self.watchers:
            watcher.ticked(tick)
        self._ticked.tell(tick)
        return tick

    def _tell_distance(self, now_s: float, vehicle: VehicleState) -> None:
        """Where a recording cannot tell it, one is assumed, so that the rest can be seen."""
        target, follow, distance_m = self.control.predict(now_s), self.config.control.follow, self.typed_distance_m
        self.distance_was_assumed = False
        if distance_m is None and target is not None:
            ground_m = ground_distance_m(target, vehicle, follow)
            if ground_m is None or not follow.min_distance_m * 1.2 <= ground_m <= follow.max_distance_m:
                distance_m, self.distance_was_assumed = ASSUMED_DISTANCE_M, True
        self.control.wanted = replace(self.control.wanted, distance_m=distance_m)

    def abort(self) -> None:
        """Zero now, not with the next tick."""
        self.control.act(Act.ABORT)
        self.step(self.clock.now_s())

    # -- the video ----------------------------------------------------------------------------------------

    def play(self) -> None:
        """Go on from the first picture."""
        if isinstance(self._source, PacedSource):
            self._go(Place.PLAYING)
            self._source.play()

    def rewind(self) -> None:
        """Back to the first picture, with nothing selected."""
        if isinstance(self._source, PacedSource):
            self._go(Place.START)
            self._source.rewind()

    def _go(self, place: Place) -> None:
        if place is not Place.PLAYING:  # time jumps: nothing of before holds
            self.vision.select(None)
            self._begin()
        self.place = place
        self._went(place)

    def _video_s(self, now_s: float) -> float:
        """Time in the video."""
        frame = self.seen.frame if self.seen is not None else None
        if not isinstance(frame, FilmFrame):
            return 0.0
        return frame.t_video_s + (now_s - frame.t_arrival_s if frame.place is Place.PLAYING else 0.0)

    def _deliver(self, seen: Seen) -> None:
        """On the vision thread."""
        with contextlib.suppress(RuntimeError):  # the loop has ended
            assert self._loop is not None
            self._loop.call_soon_threadsafe(self.saw, seen)

    def saw(self, seen: Seen) -> None:
        """Take a frame that has been through the tracker, on the event loop."""
        if self.place is Place.PLAYING and isinstance(seen.frame, FilmFrame) and seen.frame.place is Place.END:
            self._go(Place.END)
        measurement = self.control.saw(seen, self.clock.now_s())
        self.seen = seen
        self._rate.note(seen.t_done_s)
        predicted = None
        if seen.result is not None:
            t_s = seen.frame.t_capture_s
            predicted = predicted_box(self.camera, self._attitude, self.control.predict(t_s), t_s, seen.result.box)
        sighting = Sighting(seen, self.status(), measurement, predicted)
        for watcher in self.watchers:
            watcher.saw(sighting)
        self._looked.tell(seen)

    # -- telling ------------------------------------------------------------------------------------------

    async def next_tick(self) -> Tick:
        """The next decision."""
        return await self._ticked.get()

    async def next_seen(self) -> Seen:
        """The next frame through the tracker."""
        return await self._looked.get()

    def why_unfit(self) -> str:
        """Nothing is unsafe about an imagined vehicle."""
        return ""

    def status(self) -> Status:
        """The state of everything, now."""
        control, now_s = self.control, self.clock.now_s()
        held = control.confirmation if control.is_engaged else None
        status = make_status(
            now_s, self.tick, self.vehicle.state(now_s), held, self.config.control.follow, self._rate.fps,
            self._warnings(), would_be_line(self.tick),
        )  # fmt: skip
        return replace(
            status,
            reasons=self._standing() or status.reasons,
            budget=self._budgets.at(now_s),
            way="imagined vehicle" + (", standing still" if self._poses is None else ", where the recorded one was"),
            follow_mode=control.wanted.mode if held is None else held.mode,
            selection=self.seen.selection if self.seen is not None else 0,
            frame_t_s=self.seen.frame.t_arrival_s if self.seen is not None else None,
            recording=self.film.on and self.place is Place.PLAYING,
        )

    def _standing(self) -> tuple[str, ...]:
        """What a video that stands still is waiting for."""
        if self.place is Place.START:
            return (READY if self.seen is not None and self.seen.selection else WAITING,)
        return (ENDED,) if self.place is Place.END else ()

    def _warnings(self) -> tuple[str, ...]:
        found = []
        if self.distance_was_assumed:
            found.append(f"the video cannot tell the distance: {ASSUMED_DISTANCE_M:g} m is assumed, or type it")
        if self._source.ended:
            found.append(self._source.problem or "the video has ended")
        return tuple(found)


def would_be_line(tick: Tick | None) -> str:
    """What a vehicle would have been told."""
    if tick is None or tick.setpoint is None:
        return "no link; nothing would be sent"
    north, east, down = tick.setpoint.velocity_ned_mps
    yaw_dps = math.degrees(tick.setpoint.yaw_rate_rps)
    return f"no link; would send N {north:+.1f} E {east:+.1f} D {down:+.1f} m/s, yaw {yaw_dps:+.0f} deg/s"


def _placed(config: Config) -> Config:
    """A fence in degrees has no place here: there is no home."""
    fence = replace(config.control.limits.fence, polygon_deg=())
    limits = replace(config.control.limits, fence=fence)
    return replace(config, control=replace(config.control, limits=limits))

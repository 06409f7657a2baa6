"""A flight: the tasks that run side by side, the 20 Hz heart among them, and the orderly end.

Whatever ends it, a signal, the operator or a fault in a task: zero velocity, then the vehicle's hold mode,
then silence. Only a vehicle that is ours is commanded; what a pilot has taken is left alone.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Coroutine
from concurrent.futures import CancelledError
from dataclasses import dataclass, replace
from typing import Any, Final

from control.camera import CameraModel
from control.gate import TICK_S
from gcs import codec
from gcs.announcer import Announcer
from gcs.audit import Audit
from gcs.auditor import Auditor
from gcs.autopilot.actions import VehicleActions
from gcs.autopilot.mode_control import ModeControl
from gcs.clock import Clock
from gcs.config import Config
from gcs.flight_control import Act, FollowControl, Tick
from gcs.flight_end import leave
from gcs.flight_modes import ModeSwitch, Spawn
from gcs.flight_output import output_of
from gcs.flight_view import (
    Sighting,
    Status,
    Watcher,
    link_summary,
    link_warnings,
    make_status,
    predicted_box,
    status_line,
)
from gcs.flight_vision import Seen, Vision
from gcs.frame_rate import FrameRate
from gcs.gimbal import Gimbal
from gcs.glass_delay import GlassDelay
from gcs.latency_budget import BudgetDisplay
from gcs.link_health import link_health
from gcs.next import Next
from gcs.recorder.events import Begun, Expected, Journal, NoJournal, RefusalNotes, Said
from gcs.recorder.film import FilmSwitch
from gcs.telemetry import Telemetry
from gcs.tracking import BoxTracker
from gcs.video import VideoSource
from gcs.wire import Wire
from tracker.box import Box

_HEARTBEAT_S: Final = 1.0
_SETTLE_S: Final = 6.0  # until the streams that were asked for must flow
_ANSWER_S: Final = 0.05  # the vision thread waits no longer than this for the filter


@dataclass(frozen=True, slots=True)
class Link:
    """The open connection to the vehicle, all its parts on one wire."""

    wire: Wire
    telemetry: Telemetry
    modes: ModeControl
    actions: VehicleActions


class Flight:
    """Everything that flies; operators act on `control`, `vision` and `link` by way of `gcs.flight_orders`."""

    def __init__(
        self,
        link: Link,
        source: VideoSource,
        tracker: BoxTracker,
        config: Config,
        clock: Clock,
        *,
        say: Callable[[str], None],
        watchers: tuple[Watcher, ...] = (),
        journal: Journal | None = None,
    ) -> None:
        """journal: where what came from outside is noted, so that the flight can be flown again."""
        self.link = link
        self.config = config
        self.clock = clock
        self.journal: Journal = journal or NoJournal()
        self.journal.note(clock.now_s(), Begun())
        self._say = say
        self.camera: CameraModel = config.camera_model(*source.size)
        attitude = link.telemetry.attitude
        self.gimbal: Gimbal | None = None
        if config.gimbal.enabled:
            self.gimbal = Gimbal(link.wire, clock, link.telemetry, config.gimbal.device_id)
            attitude = self.gimbal.attitude
        backend, limits = config.vehicle.backend, config.control.limits
        self.output = output_of(backend, link.wire, link.telemetry, self.camera, limits)
        self.glass = GlassDelay(config.camera.glass_delay_s, self.camera, attitude)
        how = {"on_gimbal": config.gimbal.enabled, "steers": self.output.steers, "delay_given": self.glass.is_given}
        self.control = FollowControl(config.control, self.camera, attitude, **how)
        self.vision = Vision(source, tracker, clock, self._deliver, self._expected, self.glass.correction_s)
        self._budgets = BudgetDisplay()
        self.tick: Tick | None = None
        self.seen: Seen | None = None
        self.watchers = watchers
        self.film: FilmSwitch | None = None
        self.record_troubles: Callable[[], tuple[str, ...]] = tuple
        self._loop: asyncio.AbstractEventLoop | None = None
        self._spawn: Spawn | None = None
        self._stopping = asyncio.Event()
        self._ticked: Next[Tick] = Next()
        self._looked: Next[Seen] = Next()
        self.modes = ModeSwitch(link.modes, self.say)
        accepted = config.vehicle.accept_parameters
        self.auditor = Auditor(link.wire, link.telemetry, clock, accepted, self.say, self._audited, backend)
        self._rate, self._settled_s = FrameRate(), clock.now_s() + _SETTLE_S
        self._announcer = Announcer(link.telemetry, self.say, clock.now_s())
        self._refusals = RefusalNotes()

    # -- running ------------------------------------------------------------------------------------------

    async def run(self, *beside: Coroutine[Any, Any, None]) -> None:
        """Fly until `stop`; `beside` are tasks that live as long (an operator). Their faults end the flight."""
        self._loop = asyncio.get_running_loop()
        self.vision.start()
        try:
            async with asyncio.TaskGroup() as group:
                self._spawn = group.create_task
                tasks = [
                    group.create_task(self._control(), name="control"),
                    group.create_task(self.link.telemetry.run(), name="telemetry"),
                    group.create_task(self.auditor.run(), name="audit"),
                    *(group.create_task(each) for each in beside),
                ]
                await self._stopping.wait()
                self.modes.cancel()
                for task in tasks:
                    task.cancel()
        finally:
            self._spawn = None
            await asyncio.gather(leave(self), *([] if self.gimbal is None else [self.gimbal.leave()]))
            # Its own thread: waiting for the frame under way must not hold up the loop.
            await asyncio.to_thread(self.vision.close)
            if self.gimbal is not None:
                self.gimbal.close()  # not before: the last pictures are seen with its attitude

    def stop(self) -> None:
        """End the flight in order: zero, hold, silence."""
        self._stopping.set()

    def abort(self) -> None:
        """Zero now, not with the next tick, and the request for hold."""
        self.control.act(Act.ABORT)
        self.step(self.clock.now_s())

    async def _control(self) -> None:
        """The 20 Hz loop. Our heartbeat comes from here, so that it ends when this does."""
        due_s = beat_s = self.clock.now_s()
        while True:
            now_s = self.clock.now_s()
            self.step(now_s)
            if now_s >= beat_s:
                self.link.wire.send_heartbeat()
                beat_s = now_s + _HEARTBEAT_S
            # After a stall the missed ticks are gone; nothing is made up for.
            due_s = due_s + TICK_S if due_s + TICK_S > now_s else now_s + TICK_S
            await asyncio.sleep(max(due_s - self.clock.now_s(), 0.0))

    def step(self, now_s: float) -> Tick:
        """One tick: decide, send once, command the modes it asks for."""
        self.control.audit_ok = not self.why_unfit()
        wire, telemetry = self.link.wire, self.link.telemetry
        home = telemetry.home_frame.home
        if home is not None:
            self.control.home_at(home.latitude_deg, home.longitude_deg)
        if self.gimbal is not None:
            self.control.gimbal = self.gimbal.state(now_s)
        tick = self.control.tick(now_s, telemetry.vehicle_state(), link_health(wire, telemetry, now_s))
        self.output.send(tick)
        if self.gimbal is not None:
            self.gimbal.step(now_s, tick.gimbal)
        self.tick = tick
        if tick.budget is not None:
            self._budgets.note(now_s, tick.budget)
        if self._spawn is not None:
            self.modes.act(tick.output.action, tick.inputs.vehicle.mode, self._spawn)
        self._announcer.ticked(tick)
        stamp_ns = telemetry.round_trip.ask(now_s)
        if stamp_ns is not None:
            wire.send_message(codec.timesync(stamp_ns))
        for watcher in self.watchers:
            watcher.ticked(tick)
        self._refusals.note(tick.t_s, self.journal, lambda: self.control.refusals(now_s, tick.inputs.vehicle))
        self._ticked.tell(tick)
        return tick

    # -- seeing -------------------------------------------------------------------------------------------

    def _deliver(self, seen: Seen) -> None:
        """On the vision thread."""
        with contextlib.suppress(RuntimeError):  # the loop has ended
            assert self._loop is not None
            self._loop.call_soon_threadsafe(self.saw, seen)

    def saw(self, seen: Seen) -> None:
        """Take a frame that has been through the tracker, on the event loop."""
        now_s = self.clock.now_s()
        if seen.flow is not None:
            self.glass.saw(seen.flow)
        measurement = self.control.saw(seen, now_s)
        self.seen = seen
        self._rate.note(seen.t_done_s)
        if self.watchers:
            predicted = self.predicted_at(seen.frame.t_capture_s, seen.result.box) if seen.result is not None else None
            sighting = Sighting(seen, self.status(), measurement, predicted, now_s)
            for watcher in self.watchers:
                watcher.saw(sighting)
        self._looked.tell(seen)

    def predicted_at(self, t_capture_s: float, like: Box) -> Box | None:
        """Where the target should be in a frame captured then, shaped like this box; None where that is unknown."""
        target = self.control.predict(t_capture_s)
        return predicted_box(self.camera, self.control.sight.attitude, target, t_capture_s, like)

    def _expected(self, t_capture_s: float, like: Box) -> Box | None:
        """On the vision thread: where a hidden target should be in a frame; None if the loop is not quick."""

        async def ask() -> Box | None:
            box = self.predicted_at(t_capture_s, like)
            self.journal.note(self.clock.now_s(), Expected(t_capture_s, like, box))
            return box

        if self._loop is None or self._loop.is_closed():
            return None
        future = asyncio.run_coroutine_threadsafe(ask(), self._loop)
        try:
            return future.result(_ANSWER_S)
        except (TimeoutError, CancelledError):
            future.cancel()
            return None

    # -- telling ------------------------------------------------------------------------------------------

    def say(self, text: str) -> None:
        """A line for the operator."""
        self.journal.note(self.clock.now_s(), Said(text))
        self._say(text)

    async def next_tick(self) -> Tick:
        """The next decision."""
        return await self._ticked.get()

    async def next_seen(self) -> Seen:
        """The next frame through the tracker."""
        return await self._looked.get()

    def status(self) -> Status:
        """The state of everything, now."""
        control, now_s = self.control, self.clock.now_s()
        confirmation = control.confirmation if control.is_engaged else None
        vehicle = self.link.telemetry.vehicle_state()
        link, fps = link_summary(self.link.wire, now_s), self._rate.fps
        follow = self.config.control.follow
        status = make_status(now_s, self.tick, vehicle, confirmation, follow, fps, self._warnings(now_s), link)
        return replace(
            status,
            budget=self._budgets.at(now_s),
            glass_delay=self.glass.estimate,
            way=self.output.label,
            follow_mode=control.wanted.mode if confirmation is None else confirmation.mode,
            standoff_m=control.wanted.standoff_m if confirmation is None else status.standoff_m,
            selection=self.seen.selection if self.seen is not None else 0,
            frame_t_s=self.seen.frame.t_arrival_s if self.seen is not None else None,
            recording=self.film.on if self.film is not None else None,
        )

    def _warnings(self, now_s: float) -> tuple[str, ...]:
        warnings: tuple[str, ...] = ()
        if now_s > self._settled_s:
            warnings = link_warnings(self.link.wire, self.link.telemetry, now_s)
            warnings += self.gimbal.warnings(now_s) if self.gimbal is not None else ()
        trouble = (f"video: {self.vision.trouble}",) if self.vision.trouble else ()
        record = tuple(f"record: {each}" for each in self.record_troubles())
        return trouble + warnings + self.glass.warnings() + record

    def status_line(self) -> str:
        """The same in one line."""
        return status_line(self.status())

    def why_unfit(self) -> str:
        """Why the vehicle may follow nobody, whatever is seen; empty if it may."""
        return self.auditor.problem or self.output.problem

    def _audited(self, audit: Audit) -> None:
        if said := self.output.audited(self.auditor.values):
            self.say(said)
        for watcher in self.watchers:
            watcher.audited(self.clock.now_s(), audit)

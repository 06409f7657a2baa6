"""A recorded flight as page and terminal see it (`gcs.operator.station.Station`); it takes no orders of a flight."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import assert_never

from control.modes import FollowMode
from control.types import VehicleState
from gcs.audit import Audit
from gcs.candidates import Candidate
from gcs.errors import GcsError
from gcs.flight_view import Sighting, Status, Watcher, make_status, status_line
from gcs.flight_vision import Seen
from gcs.frame_rate import FrameRate
from gcs.latency_budget import BudgetDisplay
from gcs.link_meters import LinkFigures
from gcs.operator.orders import Order
from gcs.operator.playback import SPEEDS, PlaybackOrder, Playhead, Speed, Timeline
from gcs.operator.station import Scene
from gcs.recorder.events import Ordered, Refusals, Said
from gcs.replay.log import FrameRow, TickRow
from gcs.replay.player import Delivered, End, Jump, Player
from gcs.replay.recorded import Moment, Recorded
from gcs.replay.timeline import Glance, words_of
from gcs.tick import Tick
from gcs.video import Frame
from gcs.video.history import FrameHistory


class NoOrdersError(GcsError):
    """What happened has happened."""


class ReplayStation:
    """Give it each moment with `took`, on the event loop; times are those of the flight's own clock.

    Pictures are counted as they are shown: one that is shown again has another number.
    """

    watermark = "REPLAY"

    def __init__(
        self, recorded: Recorded, glance: Glance | None = None, say: Callable[[str], None] = lambda text: None
    ) -> None:
        """glance: for the map. say: what was ordered and said, as it happens."""
        self.size = recorded.film.size
        self.hfov_rad = recorded.hfov_rad
        self.player: Player | None = None  # that the page steers
        self.has_ended = False
        self._recorded, self._glance, self._say = recorded, glance, say
        self._watchers: tuple[Watcher, ...] = ()
        self._shown = 0
        self._forget()

    def _forget(self) -> None:
        self.frames = FrameHistory()
        self.has_ended = False
        self._rate, self._budgets = FrameRate(), BudgetDisplay()
        self._now_s = self._recorded.log.start_s
        self._tick: Tick | None = None
        self._link = ""
        self._refusals: tuple[str, ...] = ()
        self._mode = FollowMode.FOLLOW
        self._selection = 0
        self._frame: int | None = None
        self._frame_t_s: float | None = None

    # -- what happens again -------------------------------------------------------------------------------

    def deliver(self, delivered: Delivered) -> None:
        """By a player."""
        match delivered:
            case Moment():
                self.took(delivered)
            case Jump(moments):
                self._jumped(moments)
            case End():
                self.has_ended = True
            case _:
                assert_never(delivered)

    def _jumped(self, moments: Iterable[Moment]) -> None:
        self._forget()
        watchers, self._watchers, say, self._say = self._watchers, (), self._say, lambda text: None
        last: Sighting | None = None
        try:
            for moment in moments:
                last = self.took(moment) or last
        finally:
            self._watchers, self._say = watchers, say
        for watcher in watchers:
            if last is not None:
                watcher.saw(replace(last, status=self.status()))
            if self._tick is not None:
                watcher.ticked(self._tick)

    def took(self, moment: Moment) -> Sighting | None:
        """Something of the flight happens again; the sighting, where it is a picture."""
        self._now_s = moment.t_s
        match moment.message:
            case TickRow() as row:
                self._ticked(row.tick)
            case FrameRow() as row:
                return self._saw(moment, row)
            case LinkFigures(received_bytes_per_s=received, sent_bytes_per_s=sent):
                self._link = f"in {received / 1000:.1f} out {sent / 1000:.1f} kB/s, as recorded"
            case Refusals(reasons):
                self._refusals = reasons
            case Ordered() | Said() as told:
                self._say(words_of(told))
            case Audit() as audit:
                for watcher in self._watchers:
                    watcher.audited(moment.t_s, audit)
        return None

    def _ticked(self, tick: Tick) -> None:
        self._tick = tick
        self._mode = tick.held.mode if tick.held is not None else tick.wanted.mode
        if tick.budget is not None:
            self._budgets.note(tick.t_s, tick.budget)
        for watcher in self._watchers:
            watcher.ticked(tick)

    def _saw(self, moment: Moment, row: FrameRow) -> Sighting | None:
        self._rate.note(row.t_done_s)
        self._selection, self._frame, self._frame_t_s = row.selection, moment.frame, row.t_arrival_s
        if moment.image_bgr is None:
            return None
        self._shown += 1
        frame = Frame(self._shown, moment.image_bgr, row.t_capture_s, row.t_arrival_s)
        self.frames.add(frame)
        is_drawn = self._recorded.film.is_annotated
        result, predicted = (None, None) if is_drawn else (row.tracked, row.predicted)
        seen = Seen(frame, row.selection, result, row.t_done_s, row.track_s, problem=row.problem)
        sighting = Sighting(seen, self.status(), row.measurement, predicted)
        for watcher in self._watchers:
            watcher.saw(sighting)
        return sighting

    # -- what is shown ------------------------------------------------------------------------------------

    def status(self) -> Status:
        """As it was then."""
        tick, now_s = self._tick, self._now_s
        vehicle = tick.inputs.vehicle if tick is not None else VehicleState()
        held = tick.held if tick is not None else None
        warnings = tuple(cause.value for cause in tick.output.warnings) if tick is not None else ()
        follow = self._recorded.config.control.follow
        status = make_status(now_s, tick, vehicle, held, follow, self._rate.fps, warnings, self._link)
        return replace(
            status,
            reasons=("the recording has ended",) if self.has_ended else status.reasons,
            budget=self._budgets.at(now_s),
            follow_mode=self._mode,
            selection=self._selection,
            frame_t_s=self._frame_t_s,
        )

    def refusals(self) -> tuple[str, ...]:
        """What would have kept a confirmation from being accepted then."""
        return self._refusals

    def scene(self) -> Scene:
        """The map."""
        if self._glance is None:
            return Scene(fence=self._recorded.fence)
        return self._glance.scene(self._now_s, self._tick, self._recorded.fence)

    def candidates(self) -> tuple[Candidate, ...]:
        """Nothing can be selected."""
        return ()

    def status_line(self) -> str:
        """The state of everything in one line."""
        return status_line(self.status())

    async def perform(self, order: Order) -> str:
        """NoOrdersError."""
        raise NoOrdersError("a recording takes no orders")

    def watch(self, watcher: Watcher) -> Callable[[], None]:
        """Tell it of every frame, tick and audit; returns how to end that."""
        self._watchers = (*self._watchers, watcher)

        def end() -> None:
            self._watchers = tuple(each for each in self._watchers if each is not watcher)

        return end

    # -- how it is played (`gcs.operator.playback.Playback`) ----------------------------------------------

    def timeline(self) -> Timeline:
        """All of it."""
        return self._glance.timeline if self._glance is not None else Timeline(self._recorded.log.span_s, (), ())

    def playhead(self) -> Playhead:
        """Now."""
        manifest, player = self._recorded.manifest, self.player
        return Playhead(
            t_s=self._now_s - self._recorded.log.start_s,
            is_playing=player is not None and player.is_playing,
            has_ended=self.has_ended,
            speed=player.speed if player is not None else 1.0,
            frame=self._frame,
            unix_s=manifest.unix_s(self._now_s) if manifest is not None else None,
        )

    def steer(self, order: PlaybackOrder) -> None:
        """Returns at once. ValueError for a speed that cannot be played."""
        if isinstance(order, Speed) and not SPEEDS[0] <= order.times <= SPEEDS[1]:
            raise ValueError(f"speed {order.times:g}: from {SPEEDS[0]:g} to {SPEEDS[1]:g}")
        if self.player is not None:
            self.player.order(order)

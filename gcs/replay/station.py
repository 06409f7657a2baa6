"""A recorded flight as page and terminal see it (`gcs.operator.station.Station`); it takes no orders."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from control.config import FollowConfig
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
from gcs.map_paths import MapPaths
from gcs.operator.orders import Order
from gcs.operator.station import Scene
from gcs.replay.log import FrameRow, TickRow
from gcs.replay.player import Moment
from gcs.tick import Tick
from gcs.video import Frame
from gcs.video.frame import Image
from gcs.video.history import FrameHistory

_HFOV_RAD: Final = math.radians(70)  # the messages do not tell it


class NoOrdersError(GcsError):
    """What happened has happened."""


class ReplayStation:
    """Give it each moment with `took`, on the event loop; times are those of the flight's own clock."""

    watermark = "REPLAY"
    hfov_rad = _HFOV_RAD

    def __init__(self, size: tuple[int, int], *, drawn_in: bool) -> None:
        """size (width, height) of the pictures, px. drawn_in: the film shows box and state already."""
        self.size = size
        self.frames = FrameHistory()
        self.has_ended = False
        self._drawn_in = drawn_in
        self._follow = FollowConfig()
        self._paths = MapPaths(self._follow)
        self._watchers: tuple[Watcher, ...] = ()
        self._rate, self._budgets = FrameRate(), BudgetDisplay()
        self._now_s = 0.0
        self._tick: Tick | None = None
        self._link = ""
        self._image: Image | None = None
        self._mode = FollowMode.FOLLOW
        self._selection = 0
        self._frame_t_s: float | None = None

    def took(self, moment: Moment) -> None:
        """Something of the flight happens again."""
        self._now_s = moment.t_s
        message = moment.message
        if isinstance(message, TickRow):
            self._ticked(message.tick)
        elif isinstance(message, FrameRow):
            self._saw(moment, message)
        elif isinstance(message, LinkFigures):
            received, sent = message.received_bytes_per_s / 1000, message.sent_bytes_per_s / 1000
            self._link = f"in {received:.1f} out {sent:.1f} kB/s, as recorded"
        elif isinstance(message, Audit):
            for watcher in self._watchers:
                watcher.audited(moment.t_s, message)

    def _ticked(self, tick: Tick) -> None:
        self._tick = tick
        if tick.held is not None:
            self._mode = tick.held.mode
        if tick.budget is not None:
            self._budgets.note(tick.t_s, tick.budget)
        self._paths.note(tick)
        for watcher in self._watchers:
            watcher.ticked(tick)

    def _saw(self, moment: Moment, row: FrameRow) -> None:
        self._rate.note(row.t_done_s)
        self._selection, self._frame_t_s = row.selection, row.t_arrival_s
        if moment.image_bgr is None or moment.frame is None:
            return
        frame = Frame(moment.frame, moment.image_bgr, row.t_capture_s, row.t_arrival_s)
        self.frames.add(frame)
        result = None if self._drawn_in else row.tracked
        seen = Seen(frame, row.selection, result, row.t_done_s, row.track_s, problem=row.problem)
        sighting = Sighting(seen, self.status(), row.measurement, None)
        for watcher in self._watchers:
            watcher.saw(sighting)

    def status(self) -> Status:
        """As it was then."""
        tick = self._tick
        vehicle = tick.inputs.vehicle if tick is not None else VehicleState()
        held = tick.held if tick is not None else None
        warnings = tuple(cause.value for cause in tick.output.warnings) if tick is not None else ()
        now_s = self._now_s
        status = make_status(now_s, tick, vehicle, held, self._follow, self._rate.fps, warnings, self._link)
        return replace(
            status,
            reasons=("the recording has ended",) if self.has_ended else status.reasons,
            budget=self._budgets.at(now_s),
            follow_mode=self._mode,
            selection=self._selection,
            frame_t_s=self._frame_t_s,
        )

    def refusals(self) -> tuple[str, ...]:
        """What kept a confirmation from being accepted then was not written down unless one was tried."""
        return ()

    def scene(self) -> Scene:
        """The map; the fence is not in the messages."""
        return self._paths.scene(self._tick, None)

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

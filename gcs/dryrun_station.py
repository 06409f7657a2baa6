"""A dry run as page and terminal see it (`gcs.operator.station.Station`)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, cast

from gcs.candidates import Candidate, CandidateFinder
from gcs.dryrun_flight import DryRunFlight
from gcs.dryrun_pace import Place, stands_at_first
from gcs.flight_orders import Orders, RefusedError
from gcs.flight_view import Status, Watcher, status_line
from gcs.operator.orders import (
    Accept,
    Acknowledge,
    Confirm,
    Deselect,
    Hold,
    Land,
    Order,
    Return,
    Select,
    SelectCandidate,
    SelectPoint,
    SetDistance,
    TakeOff,
)
from gcs.operator.station import Scene
from gcs.video.history import FrameHistory
from tracker.box import Box

if TYPE_CHECKING:
    from gcs.flight import Flight

_FOR_VEHICLES: Final = (Hold, TakeOff, Land, Return, Accept)
_SELECTS: Final = (Select, SelectPoint, SelectCandidate)


class DryRunStation:
    """A box drawn on the first picture starts the video; confirming and aborting act on an imagined vehicle.

    A box that was given beforehand is selected there, and the video starts when it is confirmed: so nobody misses the
    start. At the last picture the video stands still, and goes back to the first when the operator drops, acknowledges
    or draws.
    """

    watermark = "DRY RUN"

    def __init__(self, flight: DryRunFlight, box: Box | None = None) -> None:
        """box: selected on the first picture by `begin`."""
        self._box = box
        self._flight = flight
        self._finder = CandidateFinder(flight.vision.frames)
        # A flight as far as these orders go: what needs a vehicle is refused here.
        self._orders = Orders(cast("Flight", flight), self.candidates)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the pictures, px."""
        return self._flight.camera.width_px, self._flight.camera.height_px

    @property
    def hfov_rad(self) -> float:
        """Horizontal field of view of the pictures."""
        return 2 * math.atan(self._flight.camera.width_px / 2 / self._flight.camera.focal_px)

    @property
    def frames(self) -> FrameHistory:
        """The pictures of the last moments."""
        return self._flight.vision.frames

    def status(self) -> Status:
        """Everything an operator's display needs, now."""
        return self._flight.status()

    def refusals(self) -> tuple[str, ...]:
        """Everything that would keep a confirmation from being accepted now."""
        flight = self._flight
        now_s = flight.clock.now_s()
        return flight.control.refusals(now_s, flight.vehicle.state(now_s))

    def scene(self) -> Scene:
        """The map."""
        return self._flight.paths.scene(self._flight.tick, self._flight.control.fence)

    def candidates(self) -> tuple[Candidate, ...]:
        """What could be selected by its number."""
        return self._finder.now()

    def status_line(self) -> str:
        """The state of everything in one line."""
        return status_line(self.status())

    def watch(self, watcher: Watcher) -> Callable[[], None]:
        """Tell it of every frame and tick; returns how to end that."""
        flight = self._flight
        flight.watchers = (*flight.watchers, watcher)

        def end() -> None:
            flight.watchers = tuple(each for each in flight.watchers if each is not watcher)

        return end

    async def perform(self, order: Order) -> str:
        """Do it; the answer for the operator. GcsError or ValueError with the reason if not."""
        flight = self._flight
        if isinstance(order, _FOR_VEHICLES):
            raise RefusedError("a dry run has no vehicle")
        if flight.place is Place.END and isinstance(order, (*_SELECTS, Deselect, Acknowledge)):
            flight.rewind()
            if isinstance(order, _SELECTS):
                raise RefusedError("that was the last picture: the video is back at its first, draw there")
            return await self.begin()
        if isinstance(order, SetDistance):
            flight.typed_distance_m = order.distance_m
        answer = await self._orders.perform(order)
        if flight.place is Place.START and isinstance(order, (*_SELECTS, Deselect, Confirm)):
            flight.play()
        return answer

    async def begin(self) -> str:
        """Wait for the first picture, and select the box that was given. GcsError as for any selection."""
        flight = self._flight
        while flight.place is Place.START and not (flight.seen is not None and stands_at_first(flight.seen.frame)):
            await flight.next_seen()
        if self._box is None:
            return "the first picture: draw a box"
        return await self._orders.perform(Select(self._box))

    def close(self) -> None:
        """End what runs beside it."""
        self._finder.close()

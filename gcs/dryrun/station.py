"""A dry run as page and terminal see it (`gcs.operator.station.Station`)."""

from __future__ import annotations

from typing import Final

from gcs.dryrun.flight import DryRunFlight
from gcs.dryrun.pace import Place, stands_at_first
from gcs.flight_orders import RefusedError
from gcs.flight_station import FlightStation
from gcs.map_paths import MapPaths
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
from gcs.tick import Tick
from tracker.box import Box

_FOR_VEHICLES: Final = (Hold, TakeOff, Land, Return, Accept)
_SELECTS: Final = (Select, SelectPoint, SelectCandidate)


class DryRunStation(FlightStation):
    """A box drawn on the first picture starts the video; confirming and aborting act on an imagined vehicle.

    A box that was given beforehand is selected there, and the video starts when it is confirmed: so nobody misses the
    start. At the last picture the video stands still, and goes back to the first when the operator drops, acknowledges
    or draws.
    """

    def __init__(self, flight: DryRunFlight, box: Box | None = None) -> None:
        """box: selected on the first picture by `begin`."""
        super().__init__(flight, "DRY RUN")
        self._box, self._dry = box, flight

    def ticked(self, tick: Tick) -> None:
        """The map's paths begin where the video does."""
        if self._dry.place is not Place.PLAYING:
            self._paths = MapPaths(self._dry.config.control.follow)
        super().ticked(tick)

    async def perform(self, order: Order) -> str:
        """Do it; the answer for the operator. GcsError or ValueError with the reason if not."""
        flight = self._dry
        if isinstance(order, _FOR_VEHICLES):
            flight.auditor.refuse()
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
        flight = self._dry
        while flight.place is Place.START and not (flight.seen is not None and stands_at_first(flight.seen.frame)):
            await flight.next_seen()
        if self._box is None:
            return "the first picture: draw a box"
        return await self._orders.perform(Select(self._box))

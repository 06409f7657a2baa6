"""A flight as page, MAVLink camera and terminal see it (`gcs.operator.station.Station`)."""

from __future__ import annotations

from collections.abc import Callable

from gcs.audit import Audit
from gcs.candidates import Candidate, CandidateFinder
from gcs.flight_control import Tick
from gcs.flight_orders import Orders
from gcs.flight_view import Sighting, Status, Watcher, status_line
from gcs.map_paths import MapPaths
from gcs.operator.orders import Order
from gcs.operator.station import Scene
from gcs.ordered import OrderedFlight
from gcs.video.history import FrameHistory


class FlightStation:
    """Also a `Watcher` of its flight: it draws the paths of the map."""

    def __init__(self, flight: OrderedFlight, watermark: str | None = None) -> None:
        self.watermark = watermark
        self._flight = flight
        self._orders = Orders(flight, self.candidates)
        self._finder = CandidateFinder(flight.vision.frames)
        self._paths = MapPaths(flight.config.control.follow)
        flight.watchers = (*flight.watchers, self)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the pictures, px."""
        return self._flight.camera.width_px, self._flight.camera.height_px

    @property
    def hfov_rad(self) -> float:
        """Horizontal field of view of the pictures."""
        return self._flight.camera.hfov_rad

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
        return flight.control.refusals(flight.clock.now_s(), flight.link.telemetry.vehicle_state())

    def status_line(self) -> str:
        """The state of everything in one line."""
        return status_line(self._flight.status())

    def candidates(self) -> tuple[Candidate, ...]:
        """What could be selected by its number."""
        return self._finder.now()

    async def perform(self, order: Order) -> str:
        """Do it; the answer for the operator. GcsError or ValueError with the reason if not."""
        return await self._orders.perform(order)

    def watch(self, watcher: Watcher) -> Callable[[], None]:
        """Tell it of every frame, tick and audit; returns how to end that."""
        flight = self._flight
        flight.watchers = (*flight.watchers, watcher)

        def end() -> None:
            flight.watchers = tuple(each for each in flight.watchers if each is not watcher)

        return end

    def close(self) -> None:
        """End what runs beside the flight."""
        self._finder.close()

    # -- the map ------------------------------------------------------------------------------------------

    def scene(self) -> Scene:
        """The map."""
        return self._paths.scene(self._flight.tick, self._flight.control.fence)

    def ticked(self, tick: Tick) -> None:
        """A point of the paths, about once a second."""
        self._paths.note(tick)

    def saw(self, sighting: Sighting) -> None:
        """Nothing is needed of the frames."""

    def audited(self, t_s: float, audit: Audit) -> None:
        """Nothing is needed of the audit."""

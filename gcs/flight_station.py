"""A flight as page, MAVLink camera and terminal see it (`gcs.operator.station.Station`)."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Final

from control.camera import CameraModel
from control.modes import ground_distance_m
from control.motion import distance_m
from gcs.audit import Audit
from gcs.candidates import Candidate, CandidateFinder
from gcs.flight import Flight
from gcs.flight_control import Tick
from gcs.flight_orders import Orders
from gcs.flight_view import Sighting, Status, Watcher
from gcs.operator.orders import Order
from gcs.operator.station import Point, Scene
from gcs.video.history import FrameHistory

_PATH_S: Final = 1.0
_PATH_POINTS: Final = 300


class FlightStation:
    """Also a `Watcher` of its flight: it draws the paths of the map."""

    def __init__(self, flight: Flight, watermark: str | None = None) -> None:
        self.watermark = watermark
        self._flight = flight
        self._orders = Orders(flight, self.candidates)
        self._finder = CandidateFinder(flight.vision.frames)
        self._vehicle_path: deque[Point] = deque(maxlen=_PATH_POINTS)
        self._target_path: deque[Point] = deque(maxlen=_PATH_POINTS)
        self._path_due_s = 0.0
        flight.watchers = (*flight.watchers, self)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the pictures, px."""
        return self._flight.camera.width_px, self._flight.camera.height_px

    @property
    def hfov_rad(self) -> float:
        """Horizontal field of view of the pictures."""
        return hfov_rad(self._flight.camera)

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
        return self._flight.status_line()

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
        vehicle = self._flight.link.telemetry.vehicle_state()
        known = vehicle.position_t_s is not None
        return Scene(
            vehicle_m=vehicle.position_ned_m[:2] if known else None,
            yaw_rad=vehicle.yaw_rad,
            target_m=self._target_m(),
            fence=self._flight.control.fence,
            vehicle_path_m=tuple(self._vehicle_path),
            target_path_m=tuple(self._target_path),
        )

    def _target_m(self) -> Point | None:
        control, vehicle = self._flight.control, self._flight.link.telemetry.vehicle_state()
        target = control.predict(self._flight.clock.now_s())
        if target is None or vehicle.position_t_s is None:
            return None
        held = control.confirmation if control.is_engaged else None
        config = self._flight.config.control.follow
        away_m = ground_distance_m(target, vehicle, config) if held is None else distance_m(held, target)
        if away_m is None or not math.isfinite(away_m):
            return None
        north_m, east_m, _ = vehicle.position_ned_m
        return north_m + away_m * math.cos(target.azimuth_rad), east_m + away_m * math.sin(target.azimuth_rad)

    def ticked(self, tick: Tick) -> None:
        """A point of the paths, about once a second."""
        if tick.t_s < self._path_due_s:
            return
        self._path_due_s = tick.t_s + _PATH_S
        vehicle = tick.inputs.vehicle
        if vehicle.position_t_s is not None:
            self._vehicle_path.append(vehicle.position_ned_m[:2])
        target_m = self._target_m()
        if target_m is not None:
            self._target_path.append(target_m)

    def saw(self, sighting: Sighting) -> None:
        """Nothing is needed of the frames."""

    def audited(self, t_s: float, audit: Audit) -> None:
        """Nothing is needed of the audit."""


def hfov_rad(camera: CameraModel) -> float:
    """Horizontal field of view, without the lens's distortion."""
    return 2 * math.atan(camera.width_px / 2 / camera.focal_px)

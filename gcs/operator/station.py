"""What page, MAVLink camera and terminal steer and show: a flight, a dry run or a replay, all alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from control.fence import Fence
from gcs.candidates import Candidate
from gcs.flight_view import Status, Watcher
from gcs.operator.orders import Order
from gcs.video.history import FrameHistory

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Scene:
    """Seen from above: metres north and east of home; None = not known. Paths: oldest first, about a point a second."""

    vehicle_m: Point | None = None
    yaw_rad: float = 0.0
    target_m: Point | None = None
    fence: Fence | None = None
    vehicle_path_m: tuple[Point, ...] = ()
    target_path_m: tuple[Point, ...] = ()


class Station(Protocol):
    """All on the event loop, but `frames`, which any thread may ask."""

    @property
    def watermark(self) -> str | None:
        """SIM, DRY RUN or REPLAY; None: this is real."""
        ...

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the pictures, px."""
        ...

    @property
    def hfov_rad(self) -> float:
        """Horizontal field of view of the pictures."""
        ...

    @property
    def frames(self) -> FrameHistory:
        """The pictures of the last moments."""
        ...

    def status(self) -> Status:
        """Everything an operator's display needs, now."""
        ...

    def refusals(self) -> tuple[str, ...]:
        """Everything that would keep a confirmation from being accepted now."""
        ...

    def scene(self) -> Scene:
        """The map."""
        ...

    def candidates(self) -> tuple[Candidate, ...]:
        """What could be selected by its number; looked for only while somebody asks."""
        ...

    def status_line(self) -> str:
        """The state of everything in one line."""
        ...

    async def perform(self, order: Order) -> str:
        """Do it; the answer for the operator. GcsError or ValueError with the reason if not."""
        ...

    def watch(self, watcher: Watcher) -> Callable[[], None]:
        """Tell it of every frame, tick and audit; returns how to end that."""
        ...

"""What stands in for the outside while a flight is flown again: its clock, its link, its camera and its vehicle."""

from __future__ import annotations

from typing import cast

from gcs.autopilot.actions import VehicleActions
from gcs.autopilot.mode_control import ModeControl
from gcs.clock import Clock
from gcs.config import Config
from gcs.flight import Flight, Link
from gcs.recorder.events import Journal
from gcs.telemetry import Telemetry
from gcs.tracking import BoxTracker
from gcs.transport import Peer, Received
from gcs.video import Frame
from gcs.wire import Wire


class RecordedClock:
    """Stands where the record says; `gcs.clock.Clock`."""

    def __init__(self) -> None:
        self.t_s = 0.0

    def now_s(self) -> float:
        """The time of the event that is being taken again."""
        return self.t_s


class RecordedLink:
    """A transport that takes everything and sends nothing; give it what was received with `received`."""

    status, connections = "recorded", 1

    def __init__(self, received: Received) -> None:
        self.received = received

    def send(self, data: bytes) -> bool:
        """Nobody is there."""
        return True

    def reply_to(self, peer: Peer) -> None:
        """Nobody is there."""

    async def close(self) -> None:
        """Nothing is open."""


class _NoPictures:
    """A source of the right size; pictures are given to the tracker by other ways."""

    name, is_live, fps, frame_count, ended, problem = "recorded", True, None, None, False, None

    def __init__(self, size: tuple[int, int]) -> None:
        self.size = size

    def read(self, timeout_s: float | None = None) -> Frame | None:
        """None."""
        return None

    def close(self) -> None:
        """Nothing is open."""


def link_again(config: Config, clock: Clock) -> tuple[Link, RecordedLink]:
    """The link of a flight with nothing at its other end."""
    ends: list[RecordedLink] = []

    def transport(received: Received) -> RecordedLink:
        ends.append(RecordedLink(received))
        return ends[0]

    vehicle = config.vehicle
    wire = Wire.over(transport, clock=clock, vehicle_system_id=vehicle.system_id, backend=vehicle.backend)
    telemetry = Telemetry(wire, clock)
    modes = ModeControl(wire, telemetry, clock)
    return Link(wire, telemetry, modes, cast(VehicleActions, None)), ends[0]


class FlightAgain(Flight):
    """A flight whose tracker and parameters were judged before; `is_fit` stands for the auditor."""

    def __init__(self, link: Link, size: tuple[int, int], config: Config, clock: Clock, journal: Journal) -> None:
        self.is_fit = True
        source, nobody = _NoPictures(size), cast(BoxTracker, None)
        super().__init__(link, source, nobody, config, clock, say=lambda text: None, journal=journal)

    def why_unfit(self) -> str:
        """As it was recorded."""
        return "" if self.is_fit else "as recorded"

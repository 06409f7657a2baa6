"""What operators' orders act on: a flight, or a dry run of one, which has no link and imports none."""

from __future__ import annotations

from typing import Protocol

from control.camera import CameraModel
from control.types import VehicleState
from gcs.clock import Clock
from gcs.config import Config
from gcs.flight_control import FollowControl
from gcs.flight_view import Status, Watcher
from gcs.flight_vision import Seen, Vision
from gcs.recorder.events import Journal
from gcs.recorder.film import FilmSwitch
from gcs.tick import Tick


class OrderedTelemetry(Protocol):
    """What is known of the vehicle."""

    def vehicle_state(self) -> VehicleState:
        """Now."""
        ...


class OrderedModes(Protocol):
    """The vehicle's modes."""

    async def hold(self) -> object:
        """GcsError if it is not seen to hold."""
        ...


class OrderedActions(Protocol):
    """What the vehicle does by itself; GcsError if it does not."""

    async def arm(self) -> None: ...

    async def takeoff(self, height_m: float) -> None: ...

    async def land(self) -> None: ...

    async def return_to_launch(self) -> None: ...


class OrderedLink(Protocol):
    """The vehicle."""

    @property
    def telemetry(self) -> OrderedTelemetry: ...

    @property
    def modes(self) -> OrderedModes: ...

    @property
    def actions(self) -> OrderedActions: ...


class OrderedOutput(Protocol):
    """See `gcs.flight_output.Output`."""

    @property
    def decides(self) -> str: ...

    @property
    def label(self) -> str: ...


class OrderedGimbal(Protocol):
    """What is wrong with a gimbal."""

    def warnings(self, now_s: float) -> tuple[str, ...]: ...


class OrderedAuditor(Protocol):
    """Who judges the vehicle's parameters."""

    def accept(self, name: str) -> str:
        """Take this one as it is; the answer for the operator."""
        ...


class OrderedFlight(Protocol):
    """All of it on the event loop. For what each part means see `gcs.flight.Flight`."""

    camera: CameraModel
    config: Config
    clock: Clock
    control: FollowControl
    vision: Vision
    tick: Tick | None
    watchers: tuple[Watcher, ...]
    journal: Journal

    @property
    def link(self) -> OrderedLink: ...

    @property
    def output(self) -> OrderedOutput: ...

    @property
    def gimbal(self) -> OrderedGimbal | None: ...

    @property
    def auditor(self) -> OrderedAuditor: ...

    @property
    def film(self) -> FilmSwitch | None: ...

    def abort(self) -> None:
        """Zero now, not with the next tick, and hold."""
        ...

    def stop(self) -> None:
        """End it in order."""
        ...

    def status(self) -> Status:
        """The state of everything, now."""
        ...

    def why_unfit(self) -> str:
        """Why the vehicle may follow nobody, whatever is seen; empty if it may."""
        ...

    async def next_tick(self) -> Tick:
        """The next decision."""
        ...

    async def next_seen(self) -> Seen:
        """The next frame through the tracker."""
        ...

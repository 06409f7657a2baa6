"""A station without a flight: a moving picture, scripted states, orders that are remembered (gcs.operator.station)."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from control.engagement import State
from control.fence import Fence
from control.types import VehicleMode, VehicleState
from gcs.audit import Audit
from gcs.candidates import Candidate
from gcs.errors import GcsError
from gcs.flight_view import Sighting, Status, Watcher
from gcs.flight_vision import Seen
from gcs.latency_budget import Budget
from gcs.operator.orders import (
    Abort,
    Acknowledge,
    Confirm,
    Deselect,
    Order,
    Record,
    Select,
    SelectCandidate,
    SelectPoint,
    SetMode,
    SetStandoff,
    StepStandoff,
)
from gcs.operator.station import Scene
from gcs.tick import Tick
from gcs.video import Frame
from gcs.video.frame import Image
from gcs.video.history import FrameHistory
from tracker.box import Box, TrackResult


@dataclass
class FakeStation:
    """Give it frames with `show` or let `run` do it; change `base` (a Status) as the test wishes."""

    size: tuple[int, int] = (640, 480)
    watermark: str | None = "SIM"
    hfov_rad: float = math.radians(70)
    refused: tuple[str, ...] = ()  # a confirmation is refused with these
    orders: list[Order] = field(default_factory=list)
    frames: FrameHistory = field(default_factory=FrameHistory)
    now_s: Callable[[], float] = time.monotonic
    visible: bool = True
    age_s: float = 0.05  # of what the vehicle said last

    def __post_init__(self) -> None:
        self.watchers: list[Watcher] = []
        self._seq = 0
        self.box: Box | None = None
        now_s = self.now_s()
        vehicle = VehicleState(
            heartbeat_t_s=now_s, mode=VehicleMode.HOLD, mode_t_s=now_s, armed=True, in_air=True, attitude_t_s=now_s,
            position_t_s=now_s, position_ned_m=(3.0, -2.0, -10.0), height_m=10.0, battery_frac=0.83,
        )  # fmt: skip
        self.base = Status(
            now_s, State.IDLE, False, (), vehicle, None, None, None, 20.0, (),
            link="in 8.1 out 1.9 kB/s, unsigned link", budget=Budget(0.1, 0.004, 0.006, 0.02, 0.012, 0.003),
            recording=True,
        )  # fmt: skip

    def status(self) -> Status:
        now_s = self.now_s()
        fresh = dict.fromkeys(("heartbeat_t_s", "mode_t_s", "attitude_t_s", "position_t_s"), now_s - self.age_s)
        newest = self.frames.newest
        return replace(
            self.base,
            t_s=now_s,
            vehicle=replace(self.base.vehicle, **fresh),
            frame_t_s=newest.t_arrival_s if newest is not None else None,
        )

    def refusals(self) -> tuple[str, ...]:
        return self.refused

    def candidates(self) -> tuple[Candidate, ...]:
        return (Candidate(1, self._target()), Candidate(2, Box(100.0, 100.0, 40.0, 30.0)))

    def scene(self) -> Scene:
        turn = self._seq / 60
        path = tuple((3.0 + 0.2 * i, -2.0 + math.sin(i / 4)) for i in range(40))
        target = (18.0 + 4 * math.sin(turn), 4 * math.cos(turn))
        return Scene((11.0, -2.0), turn % 6.28, target, Fence(radius_m=60.0), path, tuple((n + 8, e) for n, e in path))

    def status_line(self) -> str:
        return self.status().headline

    def watch(self, watcher: Watcher) -> Callable[[], None]:
        self.watchers.append(watcher)
        return lambda: self.watchers.remove(watcher)

    async def perform(self, order: Order) -> str:
        self.orders.append(order)
        match order:
            case Select(box):
                return self._selected(box)
            case SelectPoint(x_px, y_px):
                return self._selected(Box(x_px, y_px, 40.0, 30.0))
            case SelectCandidate(number):
                return self._selected(self.candidates()[number - 1].box)
            case Deselect():
                self.box, self.base = None, replace(self.base, state=State.IDLE, selection=0, confidence=None)
            case Confirm():
                if self.refused:
                    self.base = replace(self.base, reasons=self.refused)
                    raise GcsError("not following: " + "; ".join(self.refused))
                vehicle = replace(self.base.vehicle, mode=VehicleMode.EXTERNAL)
                self.base = replace(
                    self.base, state=State.FOLLOWING, vehicle=vehicle, distance_m=15.4, standoff_m=15.0, reasons=()
                )
                return "follow confirmed at 15.0 m"
            case Abort():
                vehicle = replace(self.base.vehicle, mode=VehicleMode.HOLD)
                self.base = replace(
                    self.base, state=State.RELEASED, reasons=("aborted by the operator",), vehicle=vehicle
                )
                return "abort: zero, then hold"
            case Acknowledge():
                self.base = replace(self.base, state=State.SELECTED if self.box else State.IDLE, reasons=())
            case SetMode(mode):
                self.base = replace(self.base, follow_mode=mode)
            case SetStandoff(standoff_m) if standoff_m is not None:
                self.base = replace(self.base, standoff_m=standoff_m)
            case StepStandoff(by_m):
                self.base = replace(self.base, standoff_m=(self.base.standoff_m or 15.0) + by_m)
            case Record(on):
                self.base = replace(self.base, recording=not self.base.recording if on is None else on)
        return "done"

    def _selected(self, box: Box) -> str:
        self.box = box
        self.base = replace(
            self.base, state=State.SELECTED, selection=self.base.selection + 1, confidence=0.87, reasons=()
        )
        return "selected"

    def _target(self) -> Box:
        width, height = self.size
        return Box(width * (0.5 + 0.3 * math.sin(self._seq / 40)), height * 0.6, width * 0.07, height * 0.06)

    def show(self) -> Sighting:
        """The next picture, through the watchers."""
        width, height = self.size
        image = np.full((height, width, 3), (90, 130, 100), np.uint8)
        image[:: height // 12] = (110, 150, 120)
        self._seq += 1
        target = self._target()
        if self.visible:
            x, y, w, h = (round(v) for v in target.xywh)
            cv2.rectangle(image, (x, y), (x + w, y + h), (40, 40, 200), -1)
        tracked = self.base.selection > 0 and self.box is not None
        result = TrackResult(target, 0.9, 0.87 if self.visible else 0.1, self.visible) if tracked else None
        return self._tell(image, result, replace(target, cx_px=target.cx_px + 4) if tracked else None)

    def _tell(self, image: Image, result: TrackResult | None = None, predicted: Box | None = None) -> Sighting:
        now_s = self.now_s()
        frame = Frame(self._seq, image, now_s - 0.1, now_s)
        self.frames.add(frame)
        seen = Seen(frame, self.base.selection, result, now_s, 0.02)
        sighting = Sighting(seen, self.status(), None, predicted)
        for watcher in tuple(self.watchers):
            watcher.saw(sighting)
        return sighting

    async def run(self, fps: float = 20.0) -> None:
        """Pictures without end."""
        while True:
            self.show()
            await asyncio.sleep(1 / fps)


class Quiet:
    """A `Watcher` to build on: it looks at nothing."""

    def saw(self, sighting: Sighting) -> None: ...

    def ticked(self, tick: Tick) -> None: ...

    def audited(self, t_s: float, audit: Audit) -> None: ...

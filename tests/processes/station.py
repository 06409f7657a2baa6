"""A station as a process of its own that does to itself what a test asks: blocks its loop, holds the interpreter.

The wire, MAVSDK, telemetry, estimator, state machine, gate and recorder are the product's. Only the picture is
imagined: a box where the target must appear to a camera on a vehicle that stands as telemetry says.

Orders come as lines on stdin, answers leave as JSON lines on stdout.
"""

from __future__ import annotations

import argparse
import asyncio
import ctypes
import itertools
import json
import math
import resource
import sys
import threading
import time
from collections import deque
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gcs.app import fly, make_flight, open_link, open_live
from gcs.clock import MonotonicClock
from gcs.config import CameraConfig, Config
from gcs.errors import GcsError
from gcs.flight import Flight
from gcs.flight_control import Tick
from gcs.flight_orders import Orders
from gcs.flight_view import Sighting
from gcs.operator.orders import Abort, Acknowledge, Confirm, Select
from gcs.recorder.folder import given_folder
from gcs.recorder.recording import Recording, recording
from gcs.signals import signals
from gcs.telemetry import Telemetry
from gcs.tracking import BoxTracker, make_tracker
from gcs.video import Frame
from gcs.video.frame import Image
from tests.gcs.blob_tracker import BlobTracker
from tests.gcs.flight_rig import box_of
from tracker.box import Box, TrackResult

_FPS = 20.0
_KEPT_TICKS = 20_000  # from the start, so that keeping them is no growth
_TEXTURE = np.random.default_rng(1).integers(0, 256, (480, 640, 3), np.uint8)
CONFIG = replace(Config(), camera=CameraConfig(hfov_deg=70.0, mount_rpy_deg=(0.0, -28.0, 0.0)))
_BOX = Box(320.0, 240.0, 40.0, 40.0)


class ImaginedCamera:
    """Live pictures of nothing at 20 Hz, no two alike in a row."""

    name, is_live, fps, size, frame_count, problem, ended = "imagined", True, _FPS, (640, 480), None, None, False

    def __init__(self) -> None:
        self._count = 0

    def read(self, timeout_s: float | None = None) -> Frame | None:
        time.sleep(1 / _FPS)
        self._count += 1
        image = np.roll(_TEXTURE, self._count, axis=1)
        now_s = time.monotonic()
        return Frame(self._count, image, now_s, now_s)

    def close(self) -> None:
        pass


class ImaginedTracker:
    """The box of a target that walks to and fro, seen from where telemetry says that the vehicle is.

    network: a tracker that does its work on every frame too, for the load; what it says is not used.
    """

    def __init__(self, telemetry: Telemetry, network: BoxTracker | None = None) -> None:
        self._telemetry = telemetry
        self._network = network
        self._begun_s = time.monotonic()

    def init(self, frame_bgr: Image, box: Box) -> None:
        if self._network is not None:
            self._network.init(frame_bgr, box)

    def look_at(self, cx_px: float, cy_px: float) -> None:
        pass

    def update(self, frame_bgr: Image) -> TrackResult:
        if self._network is not None:
            self._network.update(frame_bgr)
        state = self._telemetry.vehicle_state()
        seconds = time.monotonic() - self._begun_s
        target = (16.0 + 4.0 * math.sin(seconds / 3), 2.0 * math.sin(seconds / 2), 0.0)
        box = box_of(target, state.position_ned_m, state.yaw_rad)
        if box is None:
            return TrackResult(Box(1.0, 1.0, 10.0, 10.0), 0.0, 0.0)
        return TrackResult(box, 1.0, 0.95)


def say(**values: Any) -> None:
    """One JSON line for the test."""
    sys.stdout.write(json.dumps({"t_s": time.monotonic(), **values}) + "\n")
    sys.stdout.flush()


class Station:
    """Carries out the test's orders beside the flight."""

    def __init__(self, flight: Flight, beats: bool) -> None:
        self._flight, self._beats = flight, beats
        self._orders = Orders(flight)
        self._tasks: set[asyncio.Task[None]] = set()
        self._state = ""
        self._tick_times_s: deque[float] = deque([0.0] * _KEPT_TICKS, maxlen=_KEPT_TICKS)

    def saw(self, sighting: Sighting) -> None:
        """Watcher: tells of each picture, if that is wanted."""
        if self._beats:
            say(arrived_s=sighting.seen.frame.t_arrival_s)

    def audited(self, t_s: float, audit: object) -> None:
        """Watcher: nothing to do."""

    def ticked(self, tick: Tick) -> None:
        """Watcher: tells each change of state, and each tick if that is wanted."""
        self._tick_times_s.append(tick.t_s)
        if self._beats:
            say(ticked_s=tick.t_s)
        state = tick.output.state.value
        if state != self._state:
            self._state = state
            say(state=state, reasons=[cause.value for cause in tick.output.reasons])

    async def run(self) -> None:
        reader = asyncio.StreamReader()
        await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
        while line := (await reader.readline()).decode().split():
            task = asyncio.create_task(self._perform(line[0], [float(word) for word in line[1:]]))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
        self._flight.stop()

    async def _perform(self, order: str, numbers: list[float]) -> None:
        say(begun=order)
        try:
            answer = await self._do(order, *numbers)
        except GcsError as error:
            say(refused=str(error))
            return
        say(done=order, answer=answer)

    async def _do(self, order: str, seconds: float = 0.0, *box: float) -> Any:
        loop = asyncio.get_running_loop()
        match order:
            case "select":
                await asyncio.sleep(seconds)
                return await self._orders.perform(Select(Box.from_xywh(*box) if box else _BOX))
            case "confirm":
                return await self._orders.perform(Confirm())
            case "abort":
                return await self._orders.perform(Abort())
            case "acknowledge":
                return await self._orders.perform(Acknowledge())
            case "block":  # the event loop
                time.sleep(seconds)
            case "gil":  # PyDLL keeps the interpreter lock: every thread stands still
                ctypes.PyDLL(None).usleep(int(seconds * 1e6))
            case "saturate":  # asyncio's default threads, and as many waiting behind them
                await asyncio.gather(*(loop.run_in_executor(None, time.sleep, seconds) for _ in range(200)))
            case "hold":  # an order by way of MAVSDK
                await self._flight.link.actions.hold()
            case "gaps":
                times = [t_s for t_s in self._tick_times_s if t_s > 0]
                return [b - a for a, b in itertools.pairwise(times)]
            case "cpu":  # s of the whole process, and of each of its threads
                clocks = {t.name: time.pthread_getcpuclockid(t.ident or 0) for t in threading.enumerate()}
                return {"all": time.process_time()} | {
                    name: time.clock_gettime(clock) for name, clock in clocks.items()
                }
            case "quit":
                self._flight.stop()
            case _:
                raise GcsError(f"unknown order {order}")
        return None


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    parser.add_argument("--vehicle", required=True)
    parser.add_argument("--video", help="a real video in place of the imagined one")
    parser.add_argument("--network", action="store_true", help="the real tracker works on every picture too")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--beats", action="store_true", help="tell of every tick and picture")
    parser.add_argument("--file-limit", type=int, help="bytes any file may have: more fails as on a full disk")
    return parser.parse_args()


async def _main(options: argparse.Namespace) -> None:
    if options.out is None:
        await _fly(options, None)
        return
    async with recording(given_folder(options.out), CONFIG, MonotonicClock(), _told) as kept:
        await _fly(options, kept)


def _told(text: str) -> None:
    say(said=text)


async def _fly(options: argparse.Namespace, kept: Recording | None) -> None:
    clock, record = MonotonicClock(), None
    film = None if kept is None else kept.film
    source = open_live(options.video, CONFIG, film) if options.video else ImaginedCamera()
    if kept is not None:
        await kept.begin("run", source, options.vehicle)
        record = kept.record
    network = make_tracker(CONFIG.tracker) if options.network else None  # before somebody waits for us
    async with open_link(options.vehicle, CONFIG, clock, record) as link:
        blob = options.video and not options.network
        tracker = BlobTracker() if blob else ImaginedTracker(link.telemetry, network)
        flight = make_flight(link, source, tracker, CONFIG, clock, _told, record)
        station = Station(flight, options.beats)
        flight.watchers = (*flight.watchers, station)
        if options.file_limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (options.file_limit, options.file_limit))
        with signals(flight.stop):
            await fly(flight, station.run())


if __name__ == "__main__":
    try:
        asyncio.run(_main(_options()))
    except GcsError as error:
        say(error=str(error))
        sys.exit(2)

"""`python -m tests.recorder.kill 100`: SIGKILL at random moments of recorded flights; then every folder must open.

A real station in a process of its own, with a mock vehicle on a real socket and a camera that sends JPEG over HTTP.
What is lost is told against what its surroundings saw of it until the kill.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import itertools
import os
import random
import sys
import tempfile
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from pymavlink import mavutil
from tqdm import tqdm

from gcs.recorder.film_reader import FilmReader
from gcs.recorder.flight_recorder import MESSAGES, TLOG
from gcs.recorder.flights import State, list_flights
from gcs.recorder.manifest import MANIFEST, read_manifest
from gcs.recorder.message_log import read_messages
from gcs.replay.log import FlightLog
from tests.gcs.mjpeg_server import MjpegServer
from tests.processes.rig import Station, Wired, station, vehicle

LOST_S = 1.0
_FRAME_S = 0.05
_ON_THE_WAY_S = 0.05  # from the log to the vehicle


@dataclass(frozen=True, slots=True)
class Loss:
    """Age, at the kill, of the oldest event that others saw and that is missing, s; None: they had seen none."""

    messages_s: float | None
    tlog_s: float | None
    film_s: float | None

    @property
    def worst_s(self) -> float:
        return max((each for each in (self.messages_s, self.tlog_s, self.film_s) if each is not None), default=0.0)


@contextlib.asynccontextmanager
async def camera() -> AsyncIterator[str]:
    """The address of one that sends JPEG."""
    rng = np.random.default_rng(1)
    pictures = [cv2.resize(rng.integers(0, 256, (120, 160, 3), np.uint8), (640, 480)) for _ in range(4)]
    jpegs = [cv2.imencode(".jpg", picture)[1].tobytes() for picture in pictures]
    server = MjpegServer()

    async def film() -> None:
        for number in itertools.count():
            server.send_bytes(jpegs[number % len(jpegs)])
            await asyncio.sleep(_FRAME_S)

    filming = asyncio.create_task(film())
    try:
        yield server.url
    finally:
        filming.cancel()
        await asyncio.to_thread(server.close)


async def kill_one(seed: int, folder: Path) -> Loss:
    """Fly, kill, open. AssertionError where something does not open."""
    chance = random.Random(seed)
    async with vehicle() as w, camera() as url:
        async with station(w.url, "--video", url, "--out", str(folder), "--beats") as s:
            async with asyncio.timeout(60.0):
                while not (folder / MANIFEST).exists():
                    await asyncio.sleep(0.01)
            if chance.random() < 0.8:  # else somewhere on the way to the first tick
                await s.hears(lambda line: "ticked_s" in line)
            await asyncio.sleep(chance.uniform(0.0, 3.0))
            kill_s = time.monotonic()
            s.process.kill()
            await s.process.wait()
        return await asyncio.to_thread(_loss, folder, kill_s, s, w)


def _loss(folder: Path, kill_s: float, s: Station, w: Wired) -> Loss:
    assert [flight.state for flight in list_flights(folder.parent)] == [State.BROKEN_OFF]
    messages_s = tlog_s = film_s = None
    if heard := [heard.t_s - _ON_THE_WAY_S for heard in w.heard]:
        manifest = read_manifest(folder)
        tlog_s = _age_s(kill_s, heard, _tlog_end_s(folder) - manifest.unix_s(0.0))
    if ticked := [line["ticked_s"] for line in s.lines if "ticked_s" in line]:
        log = FlightLog(folder)
        assert sum(1 for _ in log) == len(log)
        assert log.dropped == log.damaged == 0
        messages_s = _age_s(kill_s, ticked, max(record.t_s for record in read_messages(folder / MESSAGES)))
    if arrived := [line["arrived_s"] for line in s.lines if "arrived_s" in line]:
        film = FilmReader(folder)
        packets = list(film.packets())
        assert film.picture(packets[-1].number) is not None
        film.close()
        film_s = _age_s(kill_s, arrived, packets[-1].t_arrival_s)
    return Loss(messages_s, tlog_s, film_s)


def _age_s(kill_s: float, known_s: list[float], end_s: float) -> float:
    """Of the oldest known event after the last that is kept."""
    return max((kill_s - each for each in known_s if each > end_s), default=0.0)


def _tlog_end_s(folder: Path) -> float:
    """Time of its last message as pymavlink reads it, seconds since 1970."""
    log = mavutil.mavlink_connection(str(folder / TLOG), dialect="development")
    end_s = 0.0
    while (message := log.recv_msg()) is not None:
        assert message.get_type() != "BAD_DATA"
        end_s = message._timestamp
    log.close()
    return end_s


async def campaign(kills: int, beside: int) -> list[Loss]:
    """So many, some at a time."""
    losses: list[Loss] = []
    free = asyncio.Semaphore(beside)
    bar = tqdm(total=kills, desc="kills", file=sys.stderr)

    async def one(seed: int) -> None:
        async with free:
            with tempfile.TemporaryDirectory() as folder:
                losses.append(await kill_one(seed, Path(folder) / "flight"))
            bar.update()

    async with asyncio.TaskGroup() as group:
        for seed in range(kills):
            group.create_task(one(seed))
    bar.close()
    return losses


def main(kills: int, beside: int) -> int:
    """Prints what was lost at most."""
    os.environ["MAVLINK20"] = "1"
    losses = asyncio.run(campaign(kills, beside))
    for name in ("messages_s", "tlog_s", "film_s"):
        lost = sorted(value for loss in losses if (value := getattr(loss, name)) is not None)
        if lost:
            print(f"{name:10} in {len(lost)} flights: median {lost[len(lost) // 2]:.2f} s, most {lost[-1]:.2f} s lost")
    worst_s = max(loss.worst_s for loss in losses)
    print(f"{len(losses)} killed, {len(losses)} folders open, at most {worst_s:.2f} s lost")
    return 0 if worst_s <= LOST_S else 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m tests.recorder.kill", description=__doc__)
    parser.add_argument("kills", nargs="?", type=int, default=100)
    parser.add_argument("--beside", type=int, default=1, metavar="N", help="flights at a time (default: 1)")
    given = parser.parse_args()
    sys.exit(main(given.kills, given.beside))

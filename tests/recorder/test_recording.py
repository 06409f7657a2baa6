"""A recording from before the video is opened to after the link is closed."""

from __future__ import annotations

import asyncio
from collections import namedtuple
from dataclasses import replace
from pathlib import Path

import pytest

from gcs.app import make_flight
from gcs.clock import FakeClock
from gcs.config import Config, RecorderConfig
from gcs.errors import GcsError
from gcs.lockstep import loop as lockstep
from gcs.lockstep.loop import LockstepLoop
from gcs.lockstep.world import Setup
from gcs.recorder import recording as module
from gcs.recorder.flight_recorder import MESSAGES, FlightRecorder
from gcs.recorder.folder import LOCK, FolderError, given_folder, new_folder
from gcs.recorder.manifest import MANIFEST, VideoFacts, read_manifest
from gcs.recorder.recording import recording
from tests.faults.world import FaultWorld
from tests.gcs.blob_tracker import BlobTracker
from tests.gcs.test_flights import flight
from tests.processes.station import ImaginedCamera

_Usage = namedtuple("_Usage", "total used free")


def config(folder: Path, **recorder: object) -> Config:
    return replace(Config(), recorder=RecorderConfig(folder=str(folder), **recorder))  # type: ignore[arg-type]


async def test_the_manifest_is_there_from_the_start_and_whole_at_the_end(tmp_path: Path) -> None:
    said: list[str] = []
    async with recording(given_folder(tmp_path), config(tmp_path), FakeClock(5.0), said.append) as kept:
        await kept.begin("run", ImaginedCamera(), "udpin://0.0.0.0:14540", watermark="SIM")
        assert kept.record is not None
        begun = read_manifest(tmp_path)
        assert (begun.ended, begun.follows, begun.weights) == (None, None, None)
        assert begun.video == VideoFacts("imagined", 640, 480, 20.0)
        assert (tmp_path / LOCK).exists()
        await kept.tracked_by(BlobTracker())
    ended = read_manifest(tmp_path)
    assert ended.ended is not None
    assert (ended.started, ended.follows, ended.dropped, ended.problems) == (begun.started, 0, 0, ())
    assert not (tmp_path / LOCK).exists()
    assert said == []


async def test_a_flight_that_never_began_leaves_nothing(tmp_path: Path) -> None:
    async def fail() -> None:
        async with recording(new_folder(tmp_path / "out"), config(tmp_path), FakeClock(), print) as kept:
            assert kept.film is not None
            raise GcsError("no such camera")

    with pytest.raises(GcsError, match="no such camera"):
        await fail()
    assert list((tmp_path / "out").iterdir()) == []


async def test_why_it_ended_and_what_is_missing_stand_in_the_manifest(tmp_path: Path) -> None:
    said: list[str] = []
    (tmp_path / "flight.tlog").mkdir()  # so that it cannot be written
    folder = module.FlightFolder(tmp_path)

    async def fail() -> None:
        async with recording(folder, config(tmp_path, video=False), FakeClock(), said.append) as kept:
            assert kept.film is None
            await kept.begin("run", ImaginedCamera(), "udpin://0.0.0.0:14540")
            raise GcsError("no vehicle at udpin://0.0.0.0:14540")

    with pytest.raises(GcsError, match="no vehicle"):
        await fail()
    trouble = f"{tmp_path / 'flight.tlog'}: file exists"
    assert read_manifest(tmp_path).problems == ("no vehicle at udpin://0.0.0.0:14540", trouble)
    assert said == [f"record: {trouble}"]


async def test_little_room_is_said_and_none_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr(module.shutil, "disk_usage", lambda _: _Usage(10e9, 9.6e9, 0.4e9))
    async with recording(new_folder(tmp_path), config(tmp_path), FakeClock(), said.append) as kept:
        await kept.begin("run", ImaginedCamera(), "udpin://0.0.0.0:14540")
    assert said == [f"record: only 0.4 GB free at {kept.path}"]

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module, "write_manifest", full)
    with pytest.raises(FolderError, match="no flight can be recorded there: no space left on device"):
        async with recording(new_folder(tmp_path), config(tmp_path), FakeClock(), said.append) as kept:
            await kept.begin("run", ImaginedCamera(), "udpin://0.0.0.0:14540")


async def test_it_makes_room_and_says_so(tmp_path: Path) -> None:
    said: list[str] = []
    old = flight(tmp_path, "flight-20010909-014640", 1e9, kb=200_000)
    async with recording(new_folder(tmp_path), config(tmp_path, keep_gb=0.1), FakeClock(), said.append) as kept:
        await kept.begin("run", ImaginedCamera(), "udpin://0.0.0.0:14540")
        async with asyncio.timeout(10.0):
            while not said:
                await asyncio.sleep(0.01)
    assert said == [f"record: {old} was removed, 0.20 GB: recorder.keep_gb is reached"]
    assert not old.exists()
    assert (kept.path / MANIFEST).exists()


async def test_a_demo_takes_nothing_away(tmp_path: Path) -> None:
    old = flight(tmp_path, "flight-20010909-014640", 1e9, kb=200_000)
    async with recording(given_folder(tmp_path / "demo"), config(tmp_path, keep_gb=0.1), FakeClock(), print) as kept:
        await kept.begin("demo", ImaginedCamera(), "udpin://0.0.0.0:14540")
        await asyncio.sleep(0.3)
    assert old.exists()


def test_trouble_with_the_record_stands_in_the_status(tmp_path: Path) -> None:
    (tmp_path / MESSAGES).mkdir()  # so that it cannot be written
    record = FlightRecorder(tmp_path, RecorderConfig())
    line = f"{tmp_path / MESSAGES}: is a directory"
    assert record.close() == [line]

    async def main(loop: LockstepLoop) -> None:
        world = FaultWorld(loop, Setup(3))
        flight = make_flight(
            world.flight.link, world.flight.vision._source, BlobTracker(), Config(), FakeClock(), print, record
        )
        assert flight.status().warnings[-1] == f"record: {line}"

    lockstep.run(main)

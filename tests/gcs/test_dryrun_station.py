"""A dry run that an operator steers, on a clock of its own: the video, the decisions, the files."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Awaitable
from dataclasses import dataclass
from pathlib import Path

import pytest

from control.engagement import State
from control.types import VehicleMode
from gcs import flight_video
from gcs.clock import FakeClock
from gcs.config import Config
from gcs.dryrun.batch import Options
from gcs.dryrun.flight import ENDED, READY, WAITING, DryRunFlight
from gcs.dryrun.pace import PacedSource
from gcs.dryrun.page import Passes
from gcs.dryrun.station import DryRunStation
from gcs.errors import SelectionError
from gcs.flight_orders import RefusedError
from gcs.operator.orders import (
    Abort,
    Confirm,
    Deselect,
    Land,
    Order,
    Select,
    SelectPoint,
    SetDistance,
    TakeOff,
)
from gcs.poses import RecordedPoses
from gcs.replay.log import FlightLog, FrameRow, TickRow
from gcs.replay.recorded import open_recorded
from gcs.video import open_source
from tests.gcs.clips import box_at, write_clip
from tests.gcs.colour_tracker import ColourTracker
from tracker.box import Box

BOX = Box.from_xywh(*box_at(0))
STEP_S = 0.01


@dataclass
class Desk:
    """The dry run with everything round it, and its time."""

    clock: FakeClock
    source: PacedSource
    flight: DryRunFlight
    station: DryRunStation
    passes: Passes
    said: list[str]
    steps: int = 0

    async def go(self, seconds: float) -> None:
        """Time passes; what the threads do is done here."""
        for _ in range(round(seconds / STEP_S)):
            self.clock.advance(STEP_S)
            self.steps += 1
            frame = self.source.read(0.0)
            if frame is not None:
                self.flight.saw(self.flight.vision.step(frame))
            if self.steps % 5 == 0:
                self.flight.step(self.clock.now_s())
            await asyncio.sleep(0)

    async def perform(self, order: Order) -> str:
        """Time passes until it is done."""
        return await self.until(self.station.perform(order))

    async def until(self, doing: Awaitable[str]) -> str:
        task = asyncio.ensure_future(doing)
        for _ in range(100):
            await self.go(0.05)
            if task.done():
                return task.result()
        raise AssertionError("it is never done")


@pytest.fixture(autouse=True)
def room_for_every_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Time here does not wait for the film's thread, which on a busy machine gets little of it."""
    monkeypatch.setattr(flight_video, "_QUEUE_FRAMES", 1000)


def desk(tmp_path: Path, frames: int = 40, telemetry: Path | None = None, config: Config | None = None) -> Desk:
    clip = write_clip(tmp_path / "a.mp4", frames=frames)
    clock, config, said = FakeClock(50.0), config or Config(), []
    source = PacedSource(lambda: open_source(str(clip)), clock)
    poses = RecordedPoses.load(telemetry) if telemetry is not None else None
    passes = Passes(Options(str(clip), tmp_path / "out", config), source, said.append)
    camera = config.camera.model(*source.size)
    flight = DryRunFlight(source, ColourTracker(), camera, config, clock, poses=poses, went=passes.went)
    passes.follow(flight)
    return Desk(clock, source, flight, DryRunStation(flight), passes, said)


async def test_the_video_waits_for_a_box_and_a_person_confirms_and_aborts(tmp_path: Path) -> None:
    at = desk(tmp_path)
    await at.go(2.0)
    status = at.station.status()
    assert (status.state, status.reasons) == (State.IDLE, (WAITING,))
    assert at.flight.seen is not None
    assert at.station.frames.newest is not None
    assert at.station.watermark == "DRY RUN"
    assert (await at.perform(Select(BOX))).startswith("selected")
    await at.go(0.3)
    status = at.station.status()
    assert (status.state, status.reasons, status.vehicle.mode) == (State.SELECTED, (), VehicleMode.HOLD)
    assert status.way == "imagined vehicle, standing still"
    assert status.link == "no link; nothing would be sent"
    assert at.station.refusals() == ()
    assert any("20 m is assumed" in warning for warning in status.warnings)
    assert await at.perform(Confirm()) == "follow confirmed at 20.0 m"
    await at.go(0.3)
    status = at.station.status()
    assert (status.state, status.vehicle.mode) == (State.FOLLOWING, VehicleMode.EXTERNAL)
    assert status.distance_m == pytest.approx(20.0, rel=0.2)
    assert "would send N" in status.link
    assert status.recording
    await at.perform(Abort())
    status = at.station.status()
    assert (status.state, status.vehicle.mode) == (State.RELEASED, VehicleMode.HOLD)
    at.source.close()


async def test_nothing_is_confirmed_by_itself(tmp_path: Path) -> None:
    at = desk(tmp_path)
    await at.perform(Select(BOX))
    await at.go(1.5)
    assert at.station.status().state is State.SELECTED
    at.source.close()


async def test_what_needs_a_vehicle_is_refused_and_what_cannot_be_selected_starts_nothing(tmp_path: Path) -> None:
    at = desk(tmp_path)
    await at.go(0.2)
    for order in (TakeOff(), Land()):
        with pytest.raises(RefusedError, match="no vehicle"):
            await at.station.perform(order)
    for bad in (Select(Box(10.0, 10.0, 4.0, 4.0)), SelectPoint(5000.0, 10.0)):
        with pytest.raises(SelectionError):
            await at.perform(bad)
    assert at.station.status().reasons == (WAITING,)
    at.source.close()


async def test_at_the_end_it_stands_writes_its_results_and_begins_again(tmp_path: Path) -> None:
    at = desk(tmp_path, frames=24)
    await at.perform(Select(BOX))
    await at.perform(Confirm())
    await at.go(2.0)
    status = at.station.status()
    assert (status.state, status.reasons, status.selection) == (State.IDLE, (ENDED,), 0)
    assert not status.recording
    summary = await at.passes.end()
    assert summary is not None
    assert at.said == [summary.line()]
    assert summary.time_lost_s == 0
    assert summary.assumed_distance_m == 20.0
    assert summary.would_be_setpoints > 5
    out = tmp_path / "out"
    rows = [[float(v) for v in line.split(",")] for line in (out / "boxes.txt").read_text().splitlines()]
    assert len(rows) == 24
    assert rows[20] == pytest.approx(box_at(20), abs=2)
    assert json.loads((out / "summary.json").read_text())["frames"] == summary.frames
    assert open_source(str(out / "annotated.mp4")).frame_count == pytest.approx(24, abs=1)
    messages = [message for _, _, message in FlightLog(out)]
    assert any(isinstance(m, TickRow) and m.held is not None for m in messages)
    assert sum(isinstance(m, FrameRow) for m in messages) == summary.frames
    moments = [moment for moment in open_recorded(out).moments() if isinstance(moment.message, FrameRow)]
    assert len({moment.image_bgr.tobytes() for moment in moments if moment.image_bgr is not None}) > 15
    with pytest.raises(RefusedError, match="last picture"):
        await at.station.perform(Select(BOX))
    await at.go(0.3)
    assert at.station.status().reasons == (WAITING,)
    await at.perform(Select(BOX))
    await at.go(0.3)
    assert at.station.status().state is State.SELECTED
    again = await at.passes.end()
    assert again is not None
    assert 2 < again.frames < 24
    at.source.close()


async def test_dropping_plays_without_a_box_and_a_typed_distance_counts(tmp_path: Path) -> None:
    at = desk(tmp_path)
    await at.go(0.2)
    await at.perform(Deselect())
    await at.go(0.5)
    status = at.station.status()
    assert (status.state, status.reasons) == (State.IDLE, ())
    frame = at.station.frames.newest
    assert frame is not None
    await at.perform(SetDistance(12.0))
    await at.perform(Select(Box.from_xywh(*box_at(10)), frame))
    assert await at.perform(Confirm()) == "follow confirmed at 12.0 m"
    assert at.station.status().warnings == ()
    await at.perform(Abort())
    summary = await at.passes.end()
    assert summary is not None
    assert summary.assumed_distance_m is None
    assert math.isnan(float((tmp_path / "out" / "boxes.txt").read_text().splitlines()[2].split(",")[0]))
    at.source.close()


async def test_the_vehicle_is_where_it_was_recorded(tmp_path: Path) -> None:
    poses = tmp_path / "poses.jsonl"
    poses.write_text(
        "".join(
            json.dumps(
                {"t_s": i / 10, "roll_rad": 0, "pitch_rad": -0.3, "yaw_rad": i / 20, "position_ned_m": [i, 0, -12]}
            )
            + "\n"
            for i in range(40)
        )
    )
    at = desk(tmp_path, telemetry=poses)
    await at.go(3.0)
    assert at.station.scene().vehicle_m == (0.0, 0.0)  # the video waits, and so does the vehicle
    await at.perform(Select(BOX))
    await at.go(1.0)
    status, scene = at.station.status(), at.station.scene()
    assert status.way == "imagined vehicle, where the recorded one was"
    assert status.vehicle.height_m == 12.0
    assert scene.vehicle_m is not None
    assert scene.vehicle_m[0] == pytest.approx(10.5, abs=1.5)
    assert scene.yaw_rad == pytest.approx(scene.vehicle_m[0] / 20, abs=0.06)
    assert scene.target_m is not None  # height and depression tell the distance
    assert status.warnings == ()
    at.source.close()


async def test_a_fence_in_degrees_does_not_keep_a_desk_from_following(tmp_path: Path) -> None:
    from dataclasses import replace

    config = Config()
    fence = replace(config.control.limits.fence, polygon_deg=((47.0, 8.0), (47.01, 8.0), (47.0, 8.01)))
    limits = replace(config.control.limits, fence=fence)
    at = desk(tmp_path, config=replace(config, control=replace(config.control, limits=limits)))
    await at.perform(Select(BOX))
    await at.go(0.2)
    assert at.station.refusals() == ()
    at.source.close()


async def test_a_box_given_beforehand_waits_for_the_confirmation_each_time(tmp_path: Path) -> None:
    at = desk(tmp_path, frames=12)
    at.station = DryRunStation(at.flight, BOX)
    assert (await at.until(at.station.begin())).startswith("selected")
    await at.go(1.0)
    status = at.station.status()
    assert (status.state, status.reasons) == (State.SELECTED, (READY,))
    assert await at.perform(Confirm()) == "follow confirmed at 20.0 m"
    await at.go(0.2)
    assert at.station.status().reasons == ()
    await at.go(1.0)
    assert at.station.status().reasons == (ENDED,)
    assert (await at.perform(Deselect())).startswith("selected")
    await at.go(0.3)
    status = at.station.status()
    assert (status.state, status.reasons) == (State.SELECTED, (READY,))
    assert at.flight.seen is not None
    assert at.flight.seen.result is not None
    assert at.flight.seen.result.box.xywh == pytest.approx(box_at(0), abs=2)
    await at.passes.end()
    at.source.close()

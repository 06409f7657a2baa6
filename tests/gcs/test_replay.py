"""A flight flown in simulated time, shown again: whole, broken off, without its film."""

from __future__ import annotations

import json
import math
import re
import shutil
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from control.engagement import State
from control.geolocation import moved_deg
from gcs.audit import Audit
from gcs.flight_view import Sighting
from gcs.operator.orders import Abort, Select
from gcs.operator.playback import Kind
from gcs.recorder.flight_recorder import MESSAGES
from gcs.recorder.manifest import MANIFEST
from gcs.replay.log import FlightLog, FrameRow, ReplayError, TickRow
from gcs.replay.recorded import open_recorded
from gcs.replay.station import NoOrdersError, ReplayStation
from gcs.replay.timeline import glance
from gcs.tick import Tick
from sitl_mocks.vehicle.telemetry import Home
from tests.gcs.replay_rig import SIZE, grey_of, record_flight
from tracker.box import Box


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_flight(tmp_path_factory.mktemp("flight"))


@pytest.fixture
def folder(flown: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(flown, tmp_path / "copy"))


class Watching:
    def __init__(self) -> None:
        self.seen: list[Sighting] = []
        self.ticks: list[Tick] = []
        self.audits: list[Audit] = []
        self.said: list[str] = []

    def saw(self, sighting: Sighting) -> None:
        self.seen.append(sighting)

    def ticked(self, tick: Tick) -> None:
        self.ticks.append(tick)

    def audited(self, t_s: float, audit: Audit) -> None:
        self.audits.append(audit)


def played(
    folder: Path, look: Callable[[ReplayStation], object] = lambda station: None
) -> tuple[Watching, ReplayStation]:
    """The whole flight at once; look: called after each moment."""
    recorded, watching = open_recorded(folder), Watching()
    station = ReplayStation(recorded, glance(recorded), watching.said.append)
    station.watch(watching)
    for moment in recorded.moments():
        station.took(moment)
        look(station)
    recorded.film.close()
    return watching, station


def test_everything_happens_again_as_it_was(flown: Path) -> None:
    states: list[str] = []
    distances: list[tuple[float | None, float | None]] = []

    def look(station: ReplayStation) -> None:
        status = station.status()
        if not states or states[-1] != status.headline:
            states.append(status.headline)
        if status.state is State.FOLLOWING:
            distances.append((status.distance_m, status.standoff_m))
            assert status.budget is not None

    watching, station = played(flown, look)
    assert station.watermark == "REPLAY"
    assert states[1:4] == ["IDLE", "IDLE: no target is selected", "SELECTED"]
    assert "COASTING: the target is not seen" in states
    assert states[-1] == "RELEASED: the operator stopped it"
    assert len(watching.audits) >= 1
    assert len(watching.ticks) == sum(isinstance(m, TickRow) for _, _, m in FlightLog(flown))
    assert all(tick.setpoint is None for tick in watching.ticks)  # what has been sent cannot be sent again
    assert distances
    assert all(distance is not None and standoff is not None for distance, standoff in distances)
    assert station.status().link.endswith("as recorded")


def test_the_map_shows_the_ways_over_the_ground_and_the_fence_of_the_flight(flown: Path, tmp_path: Path) -> None:
    lengths = []
    _, station = played(flown, lambda station: lengths.append(len(station.scene().vehicle_path_m)))
    scene = station.scene()
    assert len(scene.vehicle_path_m) > 4
    assert lengths == sorted(lengths)
    assert scene.target_path_m
    assert scene.fence == open_recorded(flown).config.control.limits.fence
    bare = Path(shutil.copytree(flown, tmp_path / "bare"))
    (bare / MANIFEST).unlink()  # as dry runs of earlier versions are
    assert played(bare)[1].scene().fence is None


def test_a_fence_in_degrees_stands_round_the_home_that_the_vehicle_told(folder: Path) -> None:
    manifest = json.loads((folder / MANIFEST).read_text())
    corners_m = ((60.0, -40.0), (60.0, 80.0), (-50.0, 10.0))
    home = Home()
    corners_deg = [moved_deg((home.latitude_deg, home.longitude_deg), corner) for corner in corners_m]
    manifest["config"]["control"]["limits"]["fence"]["polygon_deg"] = corners_deg
    (folder / MANIFEST).write_text(json.dumps(manifest))
    fence = open_recorded(folder).fence
    assert fence is not None
    assert np.array(fence.polygon_m) == pytest.approx(np.array(corners_m), abs=0.5)
    manifest["kind"] = "import"  # nobody of ours kept it
    (folder / MANIFEST).write_text(json.dumps(manifest))
    assert open_recorded(folder).fence is None


def test_lens_and_time_of_day_are_those_of_the_manifest(folder: Path) -> None:
    recorded = open_recorded(folder)
    assert recorded.hfov_rad == recorded.config.camera_model(*SIZE).hfov_rad
    station = ReplayStation(recorded)
    for moment in recorded.moments(pictures=False):
        station.took(moment)
    head, manifest = station.playhead(), recorded.manifest
    assert manifest is not None
    assert head.unix_s == pytest.approx(manifest.unix_start_s + head.t_s, abs=0.1)
    text = (folder / MANIFEST).read_text()
    (folder / MANIFEST).write_text(re.sub(r'"radius_m": [\d.]+', '"radius_m": -5', text))
    assert any("configuration" in problem for problem in open_recorded(folder).problems)
    (folder / MANIFEST).write_text(text[:100])
    damaged = open_recorded(folder)
    assert any("not a manifest" in problem for problem in damaged.problems)
    assert damaged.hfov_rad == math.radians(70)


def test_what_was_ordered_said_and_refused_is_told_again(flown: Path) -> None:
    refused = set()
    watching, station = played(flown, lambda station: refused.update(station.refusals()))
    said = "\n".join(watching.said)
    assert "follow refused: " in said
    assert "abort: abort: zero, then hold" in said
    assert refused
    events = station.timeline().events
    assert [event.t_s for event in events] == sorted(event.t_s for event in events)
    assert [event.text for event in events].count("FOLLOWING") == 2  # after the loss again, each told once
    assert {Kind.STATE, Kind.ORDERED, Kind.REFUSED} <= {event.kind for event in events}
    stretches = station.timeline().stretches
    assert [stretch.state for stretch in stretches][:3] == ["NO VIDEO", "IDLE", "SELECTED"]
    assert "COASTING" in [stretch.state for stretch in stretches]
    assert all(a.end_s == b.begin_s for a, b in pairwise(stretches))


def test_each_frame_comes_with_its_own_picture_its_box_and_its_prediction(flown: Path) -> None:
    watching, station = played(flown)
    assert station.size == SIZE
    rows = [message for _, _, message in FlightLog(flown) if isinstance(message, FrameRow)]
    numbers = [number for _, number, message in FlightLog(flown) if isinstance(message, FrameRow)]
    assert len(watching.seen) == len(rows) > 80
    for sighting, row, number in zip(watching.seen, rows, numbers, strict=True):
        assert number is not None
        assert int(sighting.seen.frame.image_bgr[2, 2, 0]) == pytest.approx(grey_of(number), abs=3)
        assert sighting.seen.result == row.tracked
        assert sighting.predicted == row.predicted
    assert any(row.predicted is not None for row in rows)
    newest = station.frames.newest
    assert newest is not None
    assert newest.seq == watching.seen[-1].seen.frame.seq


async def test_it_takes_no_orders(flown: Path) -> None:
    station = ReplayStation(open_recorded(flown))
    for order in (Abort(), Select(Box(30.0, 30.0, 10.0, 10.0))):
        with pytest.raises(NoOrdersError, match="takes no orders"):
            await station.perform(order)


def test_a_flight_broken_off_plays_as_far_as_it_went(folder: Path) -> None:
    """As a killed program leaves it: a film that ends in a picture, a last line cut off."""
    whole = (folder / MESSAGES).read_bytes()
    (folder / MESSAGES).write_bytes(whole[: len(whole) * 2 // 3])
    film = folder / "film.mjpeg"
    film.write_bytes(film.read_bytes()[: film.stat().st_size // 2])
    recorded = open_recorded(folder)
    assert recorded.log.is_cut
    watching, station = played(folder)
    assert station.size == SIZE
    assert len(watching.seen) > 50
    last = watching.seen[-1].seen
    assert last.frame.image_bgr.shape == (SIZE[1], SIZE[0], 3)
    assert last.result is not None
    assert watching.ticks[-1].output.state in (State.FOLLOWING, State.COASTING)
    assert station.status().reasons != ("the recording has ended",)
    station.has_ended = True
    assert station.status().reasons == ("the recording has ended",)


def test_without_its_film_the_pictures_are_grey(folder: Path) -> None:
    for film in folder.glob("film.*"):
        film.unlink()
    assert any("no film" in problem for problem in open_recorded(folder).problems)
    watching, station = played(folder)
    last = watching.seen[-1].seen
    assert len(set(last.frame.image_bgr.ravel().tolist())) == 1
    assert last.result is not None  # the page draws it
    assert station.size == (640, 480)


def test_lines_that_cannot_be_read_are_left_out_and_counted(folder: Path) -> None:
    lines = (folder / MESSAGES).read_bytes().splitlines(keepends=True)
    ticks = [at for at, line in enumerate(lines) if b'"type":"Tick"' in line]
    lines[10] = b"\xff\xfe nothing\n"
    lines[ticks[20]] = lines[ticks[20]].replace(b'"inputs"', b'"outputs"')
    del lines[ticks[30] : ticks[30] + 3]
    (folder / MESSAGES).write_bytes(b"".join(lines))
    log = FlightLog(folder)
    assert len(list(log)) == len(lines) - 2
    assert log.damaged == 2
    assert log.dropped == 3
    assert not log.is_cut


def test_a_folder_without_a_flight_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ReplayError, match="no such folder"):
        open_recorded(tmp_path / "none")
    with pytest.raises(ReplayError, match="no such file"):
        open_recorded(tmp_path)
    (tmp_path / MESSAGES).write_bytes(b'{"n":0,"t_s":1.0,"type":"Tracked","frame":0,"data":{}}\n')
    with pytest.raises(ReplayError, match="no flight in it"):
        open_recorded(tmp_path)
    (tmp_path / MESSAGES).write_bytes(b'{"n":0,"t_s":1.0,"type":"Tick","frame":null,"data":{"would_be":null}}\n')
    with pytest.raises(ReplayError, match="no message of a flight"):
        open_recorded(tmp_path)


def test_messages_are_found_by_time_and_kind(flown: Path) -> None:
    log = FlightLog(flown)
    ticks = log.places(TickRow)
    assert [message for _, _, message in log.read(ticks[:3])] == [m for _, _, m in log if isinstance(m, TickRow)][:3]
    place = log.place_at(log.start_s + 3.0)
    assert log.time_s(place - 1) <= log.start_s + 3.0 < log.time_s(place)
    before, after = log.newest(TickRow, place), log.next(TickRow, place)
    assert before is not None
    assert after == ticks[ticks.index(before) + 1]
    assert log.next(TickRow, ticks[-1] + 1) is None
    assert log.newest(TickRow, 0) is None

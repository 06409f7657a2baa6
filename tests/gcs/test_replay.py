"""A flight flown in simulated time, played again and summed up; whole, broken off, and without its film."""

from __future__ import annotations

import argparse
import asyncio
import json
import re
import shutil
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import aiohttp
import pytest

from control.engagement import State
from gcs.audit import Audit
from gcs.clock import FakeClock
from gcs.errors import GcsError
from gcs.flight_view import Sighting
from gcs.operator.orders import Abort, Select
from gcs.recorder.flight_recorder import MESSAGES
from gcs.replay import play as replay
from gcs.replay.film import VIDEO
from gcs.replay.log import FlightLog, FrameRow, ReplayError, TickRow
from gcs.replay.play import open_flight, station_of
from gcs.replay.player import Moment, Player
from gcs.replay.station import NoOrdersError, ReplayStation
from gcs.report import make as report
from gcs.tick import Tick
from tests.gcs.replay_rig import SIZE, grey_of, record_flight
from tracker.box import Box


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_flight(tmp_path_factory.mktemp("flight"))


@pytest.fixture
def folder(flown: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(flown, tmp_path / "copy"))


class Running(FakeClock):
    """Time passes whenever somebody looks: nothing has to be waited for."""

    def now_s(self) -> float:
        return self.advance(0.0001)


class Watching:
    def __init__(self) -> None:
        self.seen: list[Sighting] = []
        self.ticks: list[Tick] = []
        self.audits: list[Audit] = []

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
    log, film = open_flight(folder)
    station, watching = station_of(film), Watching()
    station.watch(watching)
    player = Player(log, film, Running(), 1e6, lambda moment: None)
    for moment in player.moments():
        station.took(moment)
        look(station)
    player.close()
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

    watching, station = played(flown, look)
    assert station.watermark == "REPLAY"
    assert states[1:4] == ["IDLE", "SELECTED", "ENGAGING"]
    assert "COASTING: the target is not seen" in states
    assert states[-1] == "RELEASED: the operator stopped it"
    assert len(watching.audits) >= 1
    assert len(watching.ticks) == sum(isinstance(m, TickRow) for _, _, m in FlightLog(flown))
    assert all(tick.setpoint is None for tick in watching.ticks)  # what has been sent cannot be sent again
    assert distances
    assert all(distance is not None and standoff is not None for distance, standoff in distances)
    scene = station.scene()
    assert len(scene.vehicle_path_m) > 4
    assert scene.target_path_m
    status = station.status()
    assert status.budget is not None
    assert status.link.endswith("as recorded")


def test_each_frame_comes_with_its_own_picture_and_no_second_overlay(flown: Path) -> None:
    watching, station = played(flown)
    assert station.size == SIZE
    assert len(watching.seen) > 80
    for sighting in watching.seen:
        frame = sighting.seen.frame
        assert int(frame.image_bgr[24, 32, 0]) == pytest.approx(grey_of(frame.seq), abs=5)
        assert sighting.seen.result is None
    newest = station.frames.newest
    assert newest is not None
    assert newest.seq == watching.seen[-1].seen.frame.seq


def test_it_keeps_the_pace_it_is_given(flown: Path) -> None:
    log, film = open_flight(flown)
    clock, waits = FakeClock(10.0), []
    player = Player(log, film, clock, 4.0, lambda moment: None)

    def wait(seconds: float) -> bool:
        waits.append(seconds)
        clock.advance(seconds)
        return False

    player._stop.wait = wait  # type: ignore[method-assign, assignment]
    moments = list(player.moments(pictures=False))
    player.close()
    assert sum(waits) == pytest.approx(log.span_s / 4)
    assert [m.t_s for m in moments] == sorted(m.t_s for m in moments)


def test_pictures_that_come_too_late_are_left_out_but_no_decision(flown: Path) -> None:
    log, film = open_flight(flown)
    clock = Running()
    player = Player(log, film, clock, 1e6, lambda moment: None)
    moments: list[Moment] = []
    for moment in player.moments():
        clock.advance(0.25)
        moments.append(moment)
    player.close()
    frames = [m for m in moments if isinstance(m.message, FrameRow)]
    assert sum(m.image_bgr is not None for m in frames) <= 1
    assert sum(isinstance(m.message, TickRow) for m in moments) > 80


async def test_it_takes_no_orders(flown: Path) -> None:
    _, film = open_flight(flown)
    station = station_of(film)
    for order in (Abort(), Select(Box(30.0, 30.0, 10.0, 10.0))):
        with pytest.raises(NoOrdersError, match="takes no orders"):
            await station.perform(order)


def test_a_flight_broken_off_plays_as_far_as_it_went(folder: Path) -> None:
    """As a killed program leaves it: a film without its index, a last line cut off."""
    whole = (folder / MESSAGES).read_bytes()
    (folder / MESSAGES).write_bytes(whole[: len(whole) * 2 // 3])
    film = (folder / VIDEO).read_bytes()
    (folder / VIDEO).write_bytes(film[: film.rindex(b"moov") - 4])
    log, broken = open_flight(folder)
    assert log.is_cut
    assert broken.problem is not None
    assert "cannot be played" in broken.problem
    watching, station = played(folder)
    assert station.size == (640, 480)
    assert len(watching.seen) > 50
    last = watching.seen[-1].seen
    assert last.frame.image_bgr.shape == (480, 640, 3)
    assert len(set(last.frame.image_bgr.ravel().tolist())) == 1
    assert last.result is not None  # there is no overlay in a grey picture: the page draws it
    assert watching.ticks[-1].output.state in (State.FOLLOWING, State.COASTING)
    assert any("middle of a follow" in said for said in report.report_of(folder).problems)
    assert station.status().reasons != ("the recording has ended",)
    station.has_ended = True
    assert station.status().reasons == ("the recording has ended",)
    (folder / VIDEO).unlink()
    assert "no film" in (open_flight(folder)[1].problem or "")


def test_lines_that_cannot_be_read_are_left_out_and_counted(folder: Path) -> None:
    lines = (folder / MESSAGES).read_bytes().splitlines(keepends=True)
    lines[10] = b"\xff\xfe nothing\n"
    lines[20] = lines[20].replace(b'"inputs"', b'"outputs"')
    del lines[30:33]
    (folder / MESSAGES).write_bytes(b"".join(lines))
    log = FlightLog(folder)
    assert len(list(log)) >= len(lines) - 2
    assert log.damaged in (1, 2)  # the second only where a decision stood there
    assert log.dropped == 3
    assert not log.is_cut


def test_a_folder_without_a_flight_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ReplayError, match="no such folder"):
        open_flight(tmp_path / "none")
    with pytest.raises(ReplayError, match="no such file"):
        open_flight(tmp_path)
    (tmp_path / MESSAGES).write_bytes(b'{"n":0,"t_s":1.0,"type":"Tracked","frame":0,"data":{}}\n')
    with pytest.raises(ReplayError, match="no flight in it"):
        open_flight(tmp_path)
    (tmp_path / MESSAGES).write_bytes(b'{"n":0,"t_s":1.0,"type":"Tick","frame":null,"data":{"would_be":null}}\n')
    with pytest.raises(ReplayError, match="no message of a flight"):
        open_flight(tmp_path)


def args(folder: Path, **more: object) -> argparse.Namespace:
    return argparse.Namespace(flight=str(folder), **{"speed": 20.0, "page": False, "port": None, "json": False, **more})


def test_without_a_page_the_flight_is_a_few_lines(
    flown: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(replay, "MonotonicClock", Running)
    monkeypatch.setattr(replay, "_MOST_SPEED", 1e7)
    assert replay.main(args(flown, speed=1e6)) == 0
    lines = capsys.readouterr().out.splitlines()
    assert 6 < len(lines) < 20
    assert "FOLLOWING" in "".join(lines)
    assert lines[-1].lstrip()[0].isdigit()
    assert "RELEASED: the operator stopped it" in lines[-1]
    with pytest.raises(GcsError, match="--speed"):
        replay.main(args(flown, speed=0.0))


async def test_the_page_shows_it_on_a_real_socket(flown: Path) -> None:
    """`gcs replay` itself: page, thread, watermark, and a refused order, through HTTP."""
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "gcs.cli", "replay", str(flown), "--port", "0",
        stdout=asyncio.subprocess.PIPE,
    )  # fmt: skip
    assert process.stdout is not None
    try:
        line = (await process.stdout.readline()).decode()
        found = re.search(r"(http://\S+)/\?token=(\S+)", line)
        assert found is not None, line
        async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as session:
            url = found.group(1)
            await session.get(f"{url}/", params={"token": found.group(2)})
            async with session.ws_connect(f"{url}/ws", headers={"Origin": url}) as ws:
                kinds: set[str] = set()
                while not {"welcome", "frame", "status", "picture"} <= kinds:
                    message = await asyncio.wait_for(ws.receive(), 20.0)
                    if message.type is aiohttp.WSMsgType.BINARY:
                        kinds.add("picture")
                        continue
                    data = json.loads(message.data)
                    kinds.add(data["type"])
                    if data["type"] == "welcome":
                        assert data["watermark"] == "REPLAY"
                        assert tuple(data["size"]) == SIZE
                    if data["type"] == "frame":
                        assert data["box"] is None
    finally:
        process.send_signal(signal.SIGINT)
    assert await process.wait() == 0


def test_the_report_tells_what_happened(flown: Path) -> None:
    found = report.report_of(flown)
    assert found.autopilot == "PX4"
    follow = found.following
    assert follow.confirmations == 1
    assert follow.seen_s + follow.unseen_s == pytest.approx(4.0, abs=0.5)
    assert (follow.losses, follow.reacquired) == (1, 1)
    assert follow.longest_loss_s == pytest.approx(0.75, abs=0.3)
    assert follow.bearing_rms_deg is not None
    assert 0.1 < follow.bearing_rms_deg < 5.0
    assert follow.distance_rms_frac is not None
    assert 0.001 < follow.distance_rms_frac < 0.5
    assert found.latency_ms["total"].median_ms == pytest.approx(130, abs=20)
    assert found.latency_ms["glass"].median_ms == pytest.approx(60, abs=1)
    assert found.limits_s
    assert found.link is not None
    assert found.link.setpoints_sent > 60
    assert found.audit is not None
    assert any("NAV_DLL_ACT is 0" in said for said in found.audit.said)
    told = [(event.kind, event.text) for event in found.timeline]
    for wanted in (
        ("operator", "confirms"),
        ("state", "ENGAGING"),
        ("operator", "aborts"),
        ("vehicle", "external, armed"),
    ):
        assert wanted in told
    assert found.longest_pause_s == pytest.approx(0.05, abs=0.01)
    assert found.problems == ()


def test_the_report_fits_a_screen_and_has_a_json_twin(flown: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert report.main(args(flown)) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) < 45
    assert max(map(len, lines)) <= 100
    text = "\n".join(lines)
    for word in ("followed", "lost", "bearing error", "distance error", "latency", "link", "RELEASED"):
        assert word in text
    assert report.main(args(flown, json=True)) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["following"]["confirmations"] == 1


def test_a_report_names_what_was_wrong_with_the_record(folder: Path) -> None:
    lines = (folder / MESSAGES).read_bytes().splitlines(keepends=True)
    del lines[30:35]
    (folder / MESSAGES).write_bytes(b"".join(lines)[:-20])
    (folder / VIDEO).unlink()
    said = " ".join(report.report_of(folder).problems)
    assert "5 messages were not written" in said
    assert "cut off" in said
    assert "no film" in said

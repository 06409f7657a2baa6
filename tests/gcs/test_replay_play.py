"""`gcs replay`: on a page, as lines, as JSON lines and as a film."""

from __future__ import annotations

import argparse
import asyncio
import itertools
import json
import re
import shutil
import signal
import sys
from pathlib import Path

import aiohttp
import cv2
import numpy as np
import pytest

from gcs.clock import FakeClock
from gcs.errors import GcsError
from gcs.replay import annotate, play
from gcs.replay.lines import play_lines
from gcs.replay.log import FlightLog, FrameRow
from gcs.replay.recorded import open_recorded
from gcs.replay.timeline import glance
from gcs.video.frame import Image
from tests.gcs.replay_rig import SIZE, record_flight
from tests.gcs.web_rig import web_rig

SOON_S = 20.0


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_flight(tmp_path_factory.mktemp("flight"))


class Running(FakeClock):
    """Time passes whenever somebody looks: nothing has to be waited for."""

    def now_s(self) -> float:
        return self.advance(0.05)


def test_lines_keep_the_pace_they_are_given(flown: Path) -> None:
    recorded, clock, waits = open_recorded(flown), FakeClock(10.0), []

    def sleep(seconds: float) -> None:
        waits.append(seconds)
        clock.advance(seconds)

    play_lines(recorded, 4.0, lambda text: None, clock, sleep)
    assert sum(waits) == pytest.approx(recorded.log.span_s / 4)


def args(folder: Path, **more: object) -> argparse.Namespace:
    usual = {"speed": 20.0, "page": False, "port": None, "json": False, "film": None}
    return argparse.Namespace(flight=str(folder), **{**usual, **more})


@pytest.fixture
def hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(play, "MonotonicClock", Running)


@pytest.mark.usefixtures("hurry")
def test_without_a_page_the_flight_is_a_few_lines(flown: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert play.main(args(flown)) == 0
    lines = capsys.readouterr().out.splitlines()
    assert 6 < len(lines) < 30
    text = "\n".join(lines)
    for told in ("FOLLOWING", "> follow refused: ", "> abort: ", "cannot follow: ", "can follow"):
        assert told in text
    assert "RELEASED: the operator stopped it" in lines[-1] + lines[-2] + lines[-3]
    with pytest.raises(GcsError, match="--speed"):
        play.main(args(flown, speed=0.0))
    with pytest.raises(GcsError, match="no such flight"):
        play.main(args(flown / "none"))


@pytest.mark.usefixtures("hurry")
def test_json_lines_hold_the_same(flown: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert play.main(args(flown, json=True)) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {row["type"] for row in rows} == {"status", "ordered", "said", "refusals"}
    assert "following" in [row.get("state") for row in rows]
    assert [row["order"] for row in rows if row["type"] == "ordered" and row["refused"]] == ["follow"]
    assert all(isinstance(row["t_s"], float) for row in rows)


@pytest.mark.parametrize("has_av", [True, False])
def test_a_film_has_the_overlay_drawn_in_and_the_flights_own_times(
    flown: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, has_av: bool
) -> None:
    if has_av:
        pytest.importorskip("av")
    else:
        monkeypatch.setattr(annotate, "find_spec", lambda name: None)
    out = tmp_path / "out.mp4"
    assert play.main(args(flown, film=str(out))) == 0
    rows = [message for _, _, message in FlightLog(flown) if isinstance(message, FrameRow)]
    video = cv2.VideoCapture(str(out))
    images, times_s = [], []
    while True:
        done, image = video.read()
        if not done:
            break
        times_s.append(video.get(cv2.CAP_PROP_POS_MSEC) / 1000)
        images.append(image)
    video.release()
    assert times_s[-1] == pytest.approx(rows[-1].t_arrival_s - rows[0].t_arrival_s, abs=0.15)
    assert len(images) == pytest.approx(len(rows), abs=2)
    begins_s = {event.text.partition(":")[0]: event.t_s for event in glance(open_recorded(flown)).timeline.events}
    start_s = FlightLog(flown).start_s

    def at(t_s: float) -> Image:
        return next(image for image, row in zip(images, rows, strict=False) if row.t_done_s - start_s > t_s)

    followed, lost = at(begins_s["COASTING"] - 0.5), at(begins_s["COASTING"] + 0.2)
    assert followed.shape == (SIZE[1], SIZE[0], 3)
    green, cyan = (80, 255, 80), (255, 230, 60)
    assert _has(followed, green)
    assert not _has(lost, green)
    assert _has(lost, cyan)  # where it should be
    assert _has(followed[25:90, 480:], (0, 190, 255))  # SIM


def _has(image: Image, colour_bgr: tuple[int, int, int]) -> bool:
    return bool((np.abs(image.astype(int) - colour_bgr).max(axis=2) < 70).any())


def test_a_film_that_cannot_be_made_is_one_line(flown: Path, tmp_path: Path) -> None:
    with pytest.raises(GcsError, match=r"must end in \.mp4"):
        play.main(args(flown, film=str(tmp_path / "out.avi")))
    with pytest.raises(GcsError, match="cannot be written"):
        play.main(args(flown, film=str(tmp_path / "none" / "out.mp4")))
    bare = Path(shutil.copytree(flown, tmp_path / "bare"))
    for film in bare.glob("film.*"):
        film.unlink()
    with pytest.raises(GcsError, match="no film"):
        play.main(args(bare, film=str(tmp_path / "out.mp4")))


class Browser:
    """One WebSocket that keeps the newest of each kind."""

    def __init__(self, ws: aiohttp.ClientWebSocketResponse) -> None:
        self.ws, self.heard, self._ids = ws, {}, itertools.count(1)

    async def hear(self) -> dict:
        while True:
            message = await asyncio.wait_for(self.ws.receive(), SOON_S)
            if message.type is aiohttp.WSMsgType.BINARY:
                self.heard["picture"] = {}
                continue
            data = json.loads(message.data)
            self.heard[data["type"]] = data
            return data

    async def ask(self, **message: object) -> dict:
        number = next(self._ids)
        await self.ws.send_json({**message, "id": number})
        while (answer := await self.hear()).get("id") != number:
            pass
        return answer


async def test_the_page_plays_it_on_a_real_socket(flown: Path) -> None:
    """`gcs replay` itself: page, thread, watermark, a seek, and a refused order, through HTTP."""
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
                await _steer(Browser(ws), url, session)
    finally:
        process.send_signal(signal.SIGINT)
    assert await process.wait() == 0


async def _steer(browser: Browser, url: str, session: aiohttp.ClientSession) -> None:
    wanted = {"welcome", "timeline", "playhead", "frame", "status", "picture", "map"}
    while not wanted <= browser.heard.keys():
        await browser.hear()
    heard = browser.heard
    assert (heard["welcome"]["watermark"], heard["welcome"]["replay"]) == ("REPLAY", True)
    assert tuple(heard["welcome"]["size"]) == SIZE
    assert "COASTING" in [stretch["state"] for stretch in heard["timeline"]["stretches"]]
    assert (await browser.ask(do="play", on=False))["ok"]
    assert (await browser.ask(do="seek", t_s=3.5))["ok"]
    while heard["playhead"]["playing"] or abs(heard["playhead"]["t_s"] - 3.5) > 0.1:
        await browser.hear()
    while heard["status"]["state"] != "following":
        await browser.hear()
    assert heard["frame"]["box"] is not None
    assert heard["frame"]["predicted"] is not None
    refused = await browser.ask(do="speed", times=1000)
    assert (refused["ok"], "speed" in refused["text"]) == (False, True)
    refused = await browser.ask(do="mode", mode="orbit")
    assert (refused["ok"], "takes no orders" in refused["text"]) == (False, True)
    assert (await session.post(f"{url}/abort", headers={"Origin": url})).status == 409


async def test_a_flight_is_not_played() -> None:
    async with web_rig() as rig:
        browser = await rig.browser()
        assert (await browser.hear("welcome"))["replay"] is False
        for do, more in (("play", {}), ("seek", {"t_s": 1.0}), ("speed", {"times": 2.0}), ("frames", {"by": 1})):
            answer = await browser.ask(do, **more)
            assert (answer["ok"], answer["text"]) == (False, "this is no recording")
        assert rig.lease.holder(rig.clock.now_s()) == ""
        assert rig.station.orders == []
        assert "playhead" not in browser.heard

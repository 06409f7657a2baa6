"""The doctor on a real video stream and on a mock vehicle on real UDP: what it finds, and what it sends."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mav

from gcs.config import Config, VehicleConfig
from gcs.doctor import judge_vehicle
from gcs.doctor import vehicle as doctor_vehicle
from gcs.doctor.check import Level, Question, Result
from gcs.doctor.vehicle import Heard, listen
from gcs.doctor.video import Watched, judge_video, video
from gcs.errors import VehicleError
from sitl_mocks.vehicle import PREPARED, MockVehicle, Personality
from sitl_mocks.vehicle.server import run_udp
from tests.gcs.clips import picture, write_clip
from tests.gcs.mjpeg_server import MjpegServer
from tests.gcs.wire_peer import free_port

ASKING = {"HEARTBEAT", "COMMAND_LONG", "PARAM_REQUEST_READ", "TIMESYNC"}
REQUESTS = {mav.MAV_CMD_SET_MESSAGE_INTERVAL, mav.MAV_CMD_REQUEST_MESSAGE}


def silent(text: str) -> None:
    """Nobody watches."""


async def looked_at(mock: MockVehicle, watch_s: float = 1.0) -> tuple[Heard, list[Any]]:
    """What is heard of it, and what it was sent."""
    port, sent, parser = free_port(), [], mav.MAVLink(None)

    def observe(datagram: bytes, _now_s: float) -> None:
        sent.extend(parser.parse_buffer(datagram) or [])

    flying = asyncio.create_task(run_udp(mock, ("127.0.0.1", port), observe=observe))
    try:
        return await listen(VehicleConfig(url=f"udpin://127.0.0.1:{port}", timeout_s=5.0), watch_s, silent), sent
    finally:
        flying.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await flying


def judged(heard: Heard, url: str = "udpin://0.0.0.0:14540") -> dict[str, Result]:
    return {result.name: result for result in judge_vehicle.judge(heard, Question(Config(), vehicle=url))}


@pytest.fixture(autouse=True)
def quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor_vehicle, "_SETTLE_S", 0.3)


@pytest.mark.parametrize("personality", list(Personality))
async def test_a_vehicle_is_only_asked_and_all_is_found(personality: Personality) -> None:
    mock = MockVehicle(personality, parameters=PREPARED[personality])
    heard, sent = await looked_at(mock)
    assert {message.get_type() for message in sent} <= ASKING
    assert {message.command for message in sent if message.get_type() == "COMMAND_LONG"} <= REQUESTS
    assert len(sent) > 20
    assert not mock.autopilot.armed
    found = judged(heard)
    assert [name for name, result in found.items() if result.level is Level.FAIL] == []
    assert found["telemetry"].figures["attitude_hz"] > 25
    assert found["round trip"].figures["round_trip_s"] < 0.5
    assert found["parameters"].level is Level.OK
    # The rest of the judgements, on what was really heard, changed in one respect each.
    check_judgements(heard)


def check_judgements(heard: Heard) -> None:
    def level(name: str, **changes: Any) -> Level:
        return judged(replace(heard, **changes))[name].level

    rates = dict(heard.rates_hz)
    assert level("telemetry", rates_hz={**rates, "ATTITUDE": 3.0}) is Level.FAIL
    assert level("telemetry", rates_hz={**rates, "ATTITUDE": 20.0}) is Level.WARN
    assert level("telemetry", rates_hz={}) is Level.FAIL
    assert level("link", loss_frac=0.05) is Level.WARN
    assert level("link", loss_frac=0.3) is Level.FAIL
    assert level("round trip", round_trips_s=[]) is Level.WARN
    assert level("round trip", round_trips_s=[0.3, 0.3]) is Level.WARN
    assert level("round trip", round_trips_s=[0.5, 0.5]) is Level.FAIL
    assert level("clock", clock_s=None) is Level.SKIP
    assert level("clock", clock_s=-3600.0) is Level.WARN
    assert level("clock", clock_s=0.5) is Level.OK
    assert level("others", stations=1) is Level.WARN
    assert level("vehicle", state=replace(heard.state, in_air=True)) is Level.WARN
    radio = judged(heard, "serial:///dev/ttyUSB0:57600")["bandwidth"]
    assert radio.level is Level.WARN or radio.figures["wanted_bytes_per_s"] <= 5760
    assert judged(heard, "serial:///dev/ttyACM0:921600")["bandwidth"].level is Level.OK
    assert "bandwidth" not in judged(heard)


async def test_factory_parameters_are_unsafe() -> None:
    heard, _ = await looked_at(MockVehicle(Personality.PX4), watch_s=0.1)
    found = judged(heard)["parameters"]
    assert found.level is Level.FAIL
    assert "COM_OBL_RC_ACT" in found.text
    assert "gcs audit" in found.fix


async def test_nobody_there_is_said_in_one_line() -> None:
    with pytest.raises(VehicleError, match="no vehicle at udpin://127"):
        await listen(VehicleConfig(url=f"udpin://127.0.0.1:{free_port()}", timeout_s=1.0), 1.0, silent)


def test_a_live_video_is_opened_and_timed() -> None:
    server, ends = MjpegServer(), threading.Event()

    def send() -> None:
        number = 0
        while not ends.wait(0.04):
            server.send(picture(number % 20))
            number += 1

    sender = threading.Thread(target=send)
    sender.start()
    try:
        results = {each.name: each for each in video(Question(Config(), video=server.url, watch_s=1.0), silent)}
    finally:
        ends.set()
        sender.join()
        server.close()
    assert results["video"].level is Level.OK
    assert "320x240 px" in results["video"].text
    assert 5 < results["video rate"].figures["fps"] <= 26


def test_a_recording_cannot_fly_and_nothing_is_a_line(tmp_path: Path) -> None:
    def level(address: str | None) -> tuple[Level, str]:
        (found,) = video(Question(Config(), video=address, watch_s=1.0), silent)
        return found.level, found.text

    assert level(str(write_clip(tmp_path / "a.mp4")))[0] is Level.WARN
    failed, text = level("http://127.0.0.1:1/video")
    assert failed is Level.FAIL
    assert "127.0.0.1:1" in text
    assert level(None)[0] is Level.SKIP


def test_how_a_video_comes_is_judged() -> None:
    def rate(*gaps_s: float, first_s: float = 0.5, broke: str | None = None) -> Level:
        arrivals_s = [0.0]
        for gap_s in gaps_s:
            arrivals_s.append(arrivals_s[-1] + gap_s)
        return list(judge_video(Watched(first_s, (640, 480), 30.0, arrivals_s, 0.002), broke))[-1].level

    assert rate(*[0.033] * 30) is Level.OK
    assert rate(*[0.125] * 30) is Level.WARN  # 8 a second
    assert rate(*[0.25] * 30) is Level.FAIL
    assert rate(*[0.033] * 30, 0.4, *[0.033] * 30) is Level.WARN  # uneven
    assert rate(0.033) is Level.FAIL
    assert rate(*[0.033] * 30, broke="the picture size changed") is Level.FAIL
    slow, _ = judge_video(Watched(6.0, (640, 480), 30.0, [0.0] * 2, 0.002), None)
    assert slow.level is Level.WARN

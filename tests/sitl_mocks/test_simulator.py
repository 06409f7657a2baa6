"""The simulator as a station meets it: a process, real sockets, OpenCV's own reader; and the recordings."""

from __future__ import annotations

import asyncio
import json
import math
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from sitl_mocks import sequences
from sitl_mocks.camera import RenderedCamera
from sitl_mocks.lens import Lens
from sitl_mocks.mjpeg import MjpegServer
from sitl_mocks.scenario import load
from sitl_mocks.sequences.follower import follow

_BITS = 10


def _numbered(number: int) -> bytes:
    """A picture that carries its number as black and white blocks."""
    picture = np.full((120, 400, 3), 90, np.uint8)
    for bit in range(_BITS):
        picture[:40, bit * 40 : bit * 40 + 40] = 255 if number >> bit & 1 else 0
    return cv2.imencode(".jpg", picture)[1].tobytes()


def _number(picture: np.ndarray[Any, Any]) -> int:
    return sum(1 << bit for bit in range(_BITS) if picture[20, bit * 40 + 20].mean() > 128)


async def _publish_until(server: MjpegServer, reading: asyncio.Future[Any]) -> None:
    number = 0
    while not reading.done():
        server.publish(_numbered(number))
        number += 1
        await asyncio.sleep(0.02)


def _read_numbers(url: str, count: int) -> list[int]:
    capture = cv2.VideoCapture(url, cv2.CAP_FFMPEG)
    assert capture.isOpened()
    pictures = [capture.read() for _ in range(count)]
    capture.release()
    assert all(ok for ok, _ in pictures)
    return [_number(np.asarray(picture)) for _, picture in pictures]


async def test_opencv_reads_the_stream_twice_at_once() -> None:
    server = MjpegServer()
    await server.start()
    reading = asyncio.gather(*(asyncio.to_thread(_read_numbers, server.url, 15) for _ in range(2)))
    await _publish_until(server, reading)
    for numbers in await reading:
        assert len(set(numbers)) == 15
        assert numbers == sorted(numbers)
    await server.close()
    assert server.viewers == 0
    server.publish(_numbered(0))  # a delayed frame that comes after the end is nobody's


async def test_a_viewer_that_does_not_read_holds_nobody_up_and_gets_new_frames_later() -> None:
    server = MjpegServer()
    await server.start()
    reader, writer = await asyncio.open_connection("127.0.0.1", server.port, limit=4096)
    writer.write(b"GET /video HTTP/1.1\r\nHost: x\r\n\r\n")
    padding = bytes(1_000_000)  # far more than all buffers between here and there
    for number in range(40):
        server.publish(b"%06d" % number + padding)
        await asyncio.sleep(0.002)
    seen: list[int] = []
    while not seen or seen[-1] != 39:
        part = await reader.readuntil(b"\r\n\r\n") if seen else await _skip_head(reader)
        length = int(part.split(b"Content-Length: ")[1].split(b"\r\n")[0])
        body = await reader.readexactly(length)
        seen.append(int(body[:6]))
    assert seen == sorted(seen)
    assert len(seen) < 15  # most were dropped
    writer.close()
    await server.close()


async def _skip_head(reader: asyncio.StreamReader) -> bytes:
    assert (await reader.readuntil(b"\r\n\r\n")).startswith(b"HTTP/1.1 200")
    return await reader.readuntil(b"\r\n\r\n")


@pytest.mark.parametrize(
    ("request_bytes", "status"),
    [(b"GET /nothing HTTP/1.1\r\n\r\n", b"404"), (b"POST /video HTTP/1.1\r\n\r\n", b"400"), (b"\r\n\r\n", b"400")],
)
async def test_other_requests_are_answered_and_closed(request_bytes: bytes, status: bytes) -> None:
    server = MjpegServer()
    await server.start()
    reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
    writer.write(request_bytes)
    assert (await reader.read()).split()[1] == status
    writer.close()
    await server.close()


@contextmanager
def _simulator(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], dict[str, Any]]]:
    command = [sys.executable, "-m", "sitl_mocks", *arguments]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    watchdog = threading.Timer(60, process.kill)
    watchdog.start()
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line, process.communicate()[1]
        yield process, json.loads(line)
    finally:
        watchdog.cancel()
        process.kill()
        process.communicate()


def test_it_ends_cleanly_with_its_stdin_if_told_to(tmp_path: Path) -> None:
    summary = tmp_path / "summary.json"
    flags = ["--fps", "2", "--summary", str(summary), "--exit-with-stdin"]
    with _simulator(*flags) as (process, _):
        assert process.stdin is not None
        process.stdin.write("of no interest\n")
        process.stdin.flush()
        assert process.poll() is None
        out, err = process.communicate(timeout=30)  # closes it
    assert (process.returncode, out, err) == (0, "", "")
    assert json.loads(summary.read_text())["scenario"] == "demo"


@pytest.mark.parametrize(
    ("number", "more", "mount_deg"), [(signal.SIGTERM, [], 0.0), (signal.SIGINT, ["--gimbal"], -28.0)]
)
def test_the_process_flies_films_and_ends_cleanly(
    tmp_path: Path, number: signal.Signals, more: list[str], mount_deg: float
) -> None:
    truth, summary = tmp_path / "truth.jsonl", tmp_path / "summary.json"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.settimeout(10)
        port = station.getsockname()[1]
        flags = ["--mavlink", f"127.0.0.1:{port}", "--start-in-air", "--fps", "10", *more]
        with _simulator(*flags, "--truth", str(truth), "--summary", str(summary)) as (process, ready):
            assert ready["ready"] is True
            assert ready["camera"]["gimbal"] is bool(more)
            assert ready["mavlink"] == f"udpin://127.0.0.1:{port}"
            assert mavlink.MAVLink(None).decode(bytearray(station.recv(2048))).get_srcSystem() == 1
            capture = cv2.VideoCapture(ready["video_url"], cv2.CAP_FFMPEG)
            picture = next(image for ok, image in iter(capture.read, None) if ok)
            capture.release()
            process.send_signal(number)
            out, err = process.communicate(timeout=30)
    assert (process.returncode, out, err) == (0, "", "")
    assert picture.shape == (480, 640, 3)
    rows = [json.loads(line) for line in truth.read_text().splitlines()]
    assert [row["seq"] for row in rows] == list(range(len(rows)))
    assert rows[0]["vehicle"]["position_ned_m"] == [0.0, 0.0, -9.0]
    assert rows[0]["target"]["position_ned_m"] == [17.5, 1.75, 0.0]
    assert len(rows[0]["box_px"]) == 4
    assert rows[0]["camera"]["roll_pitch_yaw_rad"][1] == pytest.approx(math.radians(mount_deg), abs=0.01)
    written = json.loads(summary.read_text())
    assert written["frames"] == len(rows)
    assert written["monitor"]["unsafe"] == 0


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--scenario", "nothing"], "scenario 'nothing' is not known"),
        (["--mavlink", "somewhere"], "'somewhere' is not HOST:PORT"),
        (["--fps", "0"], "0 is not between 1 and 120"),
        (["--signing-key", __file__], "not a key in hexadecimal"),
        (["--truth", "/nonexistent/folder/truth.jsonl"], "/nonexistent/folder/truth.jsonl"),
    ],
)
def test_what_cannot_be_done_is_one_line(arguments: list[str], text: str) -> None:
    command = [sys.executable, "-m", "sitl_mocks", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert text in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("name", ["car", "walk", "zigzag"])
def test_a_recorded_sequence_is_whole(name: str) -> None:
    about = json.loads(sequences.path(name, ".json").read_text())
    boxes = np.genfromtxt(sequences.path(name, ".txt"), delimiter=",")
    telemetry = [json.loads(line) for line in sequences.path(name, ".jsonl").read_text().splitlines()]
    capture = cv2.VideoCapture(str(sequences.path(name)))
    count = 0
    while capture.read()[0]:
        count += 1
    assert count == about["frames"] == len(boxes) == len(telemetry)
    assert 6 <= count / about["fps"] <= 12
    assert 10 <= about["fps"] <= 20
    assert not np.isnan(boxes[0]).any()
    assert np.isnan(boxes).any() == (name != "zigzag")  # the other two are hidden for a while
    assert telemetry[0]["t_s"] == 0.0
    assert telemetry[-1]["t_s"] == pytest.approx((count - 1) / about["fps"])


def test_the_recordings_show_what_the_simulator_renders_today() -> None:
    about = json.loads(sequences.path("zigzag", ".json").read_text())
    lens = Lens(**{**about["lens"], "distortion": tuple(about["lens"]["distortion"])})
    row = json.loads(sequences.path("zigzag", ".jsonl").read_text().splitlines()[0])
    scenario = load(about["scenario"])
    moment = next(m for m in follow(scenario, about["fps"], 20.0) if m.t_s >= 10.0)
    assert moment.position_ned_m == pytest.approx(row["position_ned_m"], abs=1e-3)
    camera = RenderedCamera(scenario.world, lens)
    pose = (moment.position_ned_m, moment.roll_rad, moment.pitch_rad, moment.yaw_rad)
    rendered = camera.render(moment.t_s, *pose)
    _, recorded = cv2.VideoCapture(str(sequences.path("zigzag"))).read()
    apart = cv2.blur(rendered.image_bgr, (5, 5)).astype(float) - cv2.blur(recorded, (5, 5))
    assert np.abs(apart).mean() < 4
    box = np.genfromtxt(sequences.path("zigzag", ".txt"), delimiter=",")[0]
    assert rendered.truth["target"].box_px == pytest.approx(box, abs=0.1)


def test_the_recordings_are_small() -> None:
    folder = sequences.path("car").parent
    assert sum(file.stat().st_size for file in folder.iterdir()) < 5_000_000


def test_an_unknown_sequence_names_those_there_are() -> None:
    assert sequences.names() == ["car", "walk", "zigzag"]
    with pytest.raises(ValueError, match="car, walk, zigzag"):
        sequences.path("boat")
    assert math.isfinite(sequences.path("car").stat().st_size)


@pytest.mark.parametrize("confirmed", [True, False])
def test_flying_without_the_operators_word_is_counted(tmp_path: Path, confirmed: bool) -> None:
    summary = tmp_path / "summary.json"
    packer = mavlink.MAVLink(None, 255, 190)
    setpoint = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 1479, 0, 0, 0, 0.1, 0, 0, 0, 0, 0, 0, 0
    )
    offboard = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 129, 6, 0, 0, 0, 0, 0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.settimeout(10)
        flags = [
            "--mavlink",
            f"127.0.0.1:{station.getsockname()[1]}",
            "--start-in-air",
            "--fps",
            "2",
            "--confirmations",
        ]
        with _simulator(*flags, "--summary", str(summary)) as (process, _):
            _, vehicle = station.recvfrom(2048)
            if confirmed:
                assert process.stdin is not None
                process.stdin.write("confirm\n")
                process.stdin.flush()
                time.sleep(0.3)
            deadline_s = time.monotonic() + 20
            while time.monotonic() < deadline_s:
                station.sendto(bytes(setpoint.pack(packer)), vehicle)
                station.sendto(bytes(offboard.pack(packer)), vehicle)
                message = mavlink.MAVLink(None).decode(bytearray(station.recv(2048)))
                if message.get_type() == "HEARTBEAT" and message.custom_mode == 6 << 16:
                    break
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=30)
    judged = json.loads(summary.read_text())["monitor"]
    assert judged["external_entries"] == 1
    assert judged["by_rule"].get("U4", 0) == (0 if confirmed else 1)

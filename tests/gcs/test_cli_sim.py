"""`gcs sim` as a process: it says where it is, is there, and ends in order."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from gcs.cli import entry as cli
from gcs.cli.sim import run_line
from gcs.config import load
from gcs.errors import EXIT_USAGE
from sitl_mocks import scenario
from tests.gcs.wire_peer import free_port


def test_it_is_there_and_ends_in_order() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.settimeout(10)
        endpoint = f"127.0.0.1:{station.getsockname()[1]}"
        command = [sys.executable, "-m", "gcs.cli", "sim", "--json", "--in-air", "--video-port", "0"]
        process = subprocess.Popen([*command, "--mavlink", endpoint], stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        try:
            said = json.loads(process.stdout.readline())
            assert station.recv(1000)[0] == 0xFD  # MAVLink 2
            with urllib.request.urlopen(said["video_url"], timeout=10) as video:
                assert b"image/jpeg" in video.read(300)
        finally:
            process.send_signal(signal.SIGINT)
            rest, _ = process.communicate(timeout=20)
    assert process.returncode == 0
    assert said["run"] == f"gcs run --profile sim --vehicle udpin://{endpoint} --video {said['video_url']}"
    end = json.loads(rest)
    assert end["event"] == "end"
    assert end["monitor"]["unsafe"] == 0


def test_the_profile_is_of_this_vehicle() -> None:
    """What `gcs sim` prints is `gcs run --profile sim` alone only because the two agree."""
    args = cli.build_parser().parse_args(["sim"])
    for gimbal, name in ((False, "sim"), (True, "sim-gimbal")):
        args.gimbal = gimbal
        assert run_line({}, args) == f"gcs run --profile {name}"
        config = load(None, name)
        assert config.vehicle.url == f"udpin://{args.mavlink}"
        assert config.video.url == f"http://127.0.0.1:{args.video_port}/video"
        assert config.gimbal.enabled is gimbal
        assert config.camera.mount_rpy_deg == ((0, 0, 0) if gimbal else (0, -28, 0))


def test_the_scenarios_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["sim", "--list"]) == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in scenario.names())


def test_what_cannot_be_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        for argv, words in (
            (["--scenario", "none"], "scenario 'none' is not known"),
            (["--wind", "3"], "--wind 3: must be N,E"),
            (["--mavlink", "here"], "--mavlink here: must be HOST:PORT"),
            (["--loss", "2"], "--loss 2"),
            (["--fps", "0"], "--fps 0"),
            (["--wait", "-1"], "--wait -1"),
            (["--video-port", "70000"], "--video-port 70000"),
            (["--video-port", port], f"port {port} for the video: address already in use"),
        ):
            assert cli.main(["sim", "--mavlink", f"127.0.0.1:{free_port()}", *argv]) == EXIT_USAGE
            shown = capsys.readouterr()
            assert words in shown.err
            assert shown.out == ""

"""What the doctor finds on this machine and in the configuration, and what its command makes of it."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from gcs.cli import entry as cli
from gcs.config import Config, RecorderConfig, TrackerConfig
from gcs.doctor import machine, ports, software
from gcs.doctor.check import Check, Level, Question, Result, Say, ok
from gcs.doctor.diagnose import diagnose
from gcs.doctor.latency import latency
from gcs.doctor.tracking import judge_speed
from gcs.errors import EXIT_FAULT, EXIT_USAGE
from gcs.operator.config import PageConfig, VideoOutConfig


def silent(text: str) -> None:
    """Nobody watches."""


def asked(check: Check, config: Config | None = None, **more: object) -> Result:
    """The last result of one check."""
    return list(check(Question(config or Config(), **more), silent))[-1]  # type: ignore[arg-type]


@pytest.fixture
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """One tick instead of a second of them."""
    monkeypatch.setattr(machine, "_TICKS", 1)


def test_a_port_that_is_taken_is_told_and_what_to_do() -> None:
    for kind, check, config in (
        (socket.SOCK_STREAM, ports.page_port, lambda port: Config(page=PageConfig(port=port))),
        (socket.SOCK_STREAM, ports.rtsp_port, lambda port: Config(video_out=VideoOutConfig(rtsp_port=port))),
    ):
        with socket.socket(socket.AF_INET, kind) as taken:
            taken.bind(("127.0.0.1", 0))
            taken.listen()
            config_of_it = config(taken.getsockname()[1])
            found = asked(check, config_of_it)
            assert (found.level, "address already in use" in found.text) == (Level.FAIL, True)
            assert "take another" in found.fix
        assert asked(check, config_of_it).level is Level.OK


def test_the_links_port() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        url = f"udpin://127.0.0.1:{taken.getsockname()[1]}"
        assert asked(ports.vehicle_port, vehicle=url).level is Level.FAIL
    assert asked(ports.vehicle_port, vehicle=url).level is Level.OK
    assert asked(ports.vehicle_port).level is Level.SKIP
    assert asked(ports.vehicle_port, vehicle="udpout://127.0.0.1:14550").level is Level.OK
    assert "udpin://HOST:PORT" in asked(ports.vehicle_port, vehicle="udp:14550").fix
    missing = asked(ports.vehicle_port, vehicle="serial:///dev/ttyNone:57600")
    assert "/dev/ttyNone: no such device" in missing.text
    assert missing.level is Level.FAIL


def test_the_disk(tmp_path: Path) -> None:
    def at(folder: Path) -> Result:
        return asked(machine.disk, Config(recorder=RecorderConfig(folder=str(folder))))

    found = at(tmp_path / "not" / "yet")
    assert found.figures["free_gb"] > 0
    assert not (tmp_path / "not").exists()  # nothing is made by looking
    (tmp_path / "file").write_text("")
    assert at(tmp_path / "file").level is Level.FAIL


def test_threads_timing_and_speed_are_judged() -> None:
    threads = asked(machine.cores, Config(tracker=TrackerConfig(threads=64)))
    assert threads.level is Level.WARN
    assert "tracker.threads" in threads.fix
    levels = [machine.judge_timing(late_s).level for late_s in (0.001, 0.05, 0.3)]
    assert levels == [Level.OK, Level.WARN, Level.FAIL]
    speeds = [judge_speed(median_ms, 0.3) for median_ms in (25, 100, 400)]
    assert [found.level for found in speeds] == [Level.OK, Level.WARN, Level.FAIL]
    assert "40 pictures a second" in speeds[0].text


def test_the_latency_is_the_sum_of_what_was_measured() -> None:
    measured = {
        "video rate": {"fps": 20.0, "decode_s": 0.005},
        "tracker": {"update_ms": 40.0},
        "round trip": {"round_trip_s": 0.02},
    }
    found = latency(Question(Config()), measured)
    assert found.figures["total_s"] == pytest.approx(0.1 + 0.005 + 0.04 + 0.025 + 0.01)
    assert found.level is Level.OK
    assert latency(Question(Config()), measured | {"tracker": {"update_ms": 150.0}}).level is Level.WARN
    assert latency(Question(Config()), measured | {"tracker": {"update_ms": 300.0}}).level is Level.FAIL
    assert latency(Question(Config()), {}).level is Level.SKIP


def test_packages_that_are_missing_or_others(tmp_path: Path) -> None:
    assert software.problems([Requirement("no-such-package>=1"), Requirement("numpy<1"), Requirement("pyyaml")]) == [
        "no-such-package is missing", f"numpy {software.installed('numpy')} is installed, <1 is needed",
    ]  # fmt: skip
    assert asked(software.packages).level is Level.OK
    (tmp_path / "constraints.txt").write_text("# pins\nnumpy==1.0.0\nno-such-package==1\n")
    found = asked(software.packages, source=tmp_path)
    assert found.level is Level.WARN
    assert "numpy" in found.text
    assert "no-such-package" not in found.text  # not installed, so not in the way


def test_an_extra_that_is_needed_and_missing_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(software, "installed", lambda name: None if name == "pyserial" else "999")
    question = Question(Config(), vehicle="serial:///dev/ttyUSB0:57600")
    found = {result.name: result for result in software.extras(question, silent)}
    assert found["extra serial"].level is Level.FAIL
    assert "climrt-gcs[serial]" in found["extra serial"].fix
    assert asked(software.extras).level is not Level.FAIL  # nobody asked for it


def test_a_check_that_breaks_hides_no_other() -> None:
    def broken(question: Question, say: Say) -> Iterator[Result]:
        raise ZeroDivisionError("oh")

    def fine(question: Question, say: Say) -> Iterator[Result]:
        yield ok("fine", "all")

    found = list(diagnose(Question(Config()), silent, (("first", broken), ("second", fine))))
    assert [(each.name, each.level) for each in found[:2]] == [("first", Level.FAIL), ("fine", Level.OK)]
    assert "ZeroDivisionError: oh" in found[0].text


@pytest.mark.usefixtures("hurried")
def test_the_command_prints_lines_of_json_and_its_status_says_whether_all_is_fine(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "c.yaml"
    config.write_text("page: {port: 0}\n")
    assert cli.main(["doctor", "--quick", "--json", "--config", str(config)]) == 0
    *checks, verdict = map(json.loads, capsys.readouterr().out.splitlines())
    assert verdict["passed"] is True
    assert {check["check"] for check in checks} > {"python", "packages", "disk", "video", "vehicle", "latency"}
    config.write_text("page: {port: 0}\nwings: 2\n")
    assert cli.main(["doctor", "--quick", "--json", "--config", str(config)]) == EXIT_FAULT
    first, *_, verdict = map(json.loads, capsys.readouterr().out.splitlines())
    assert verdict["passed"] is False
    assert (first["check"], first["level"]) == ("configuration", "fail")
    assert "c.yaml:2: wings: unknown key" in first["text"]


@pytest.mark.usefixtures("hurried")
def test_the_table_says_what_to_fix(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    argv = ["doctor", "--quick", "--video", "nowhere.mp4", "--vehicle", "serial:///dev/ttyNone:57600"]
    assert cli.main(argv) == EXIT_FAULT
    shown = capsys.readouterr().out
    assert all(len(line.rstrip()) <= 80 for line in shown.splitlines())
    assert "fail  video" in shown
    assert "fix: " in shown
    assert "to fix before a flight" in shown.splitlines()[-1]


def test_misuse_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["doctor", "--seconds", "0"]) == EXIT_USAGE
    assert "--seconds 0: must be from 1 to 60" in capsys.readouterr().err


def test_no_pytorch_where_the_tracker_is_not_looked_at() -> None:
    program = (
        "import sys\nfrom gcs.doctor import machine\nmachine._TICKS = 1\nfrom gcs.cli.entry import main\n"
        "main(['doctor', '--quick', '--json'])\nprint('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "False"


def test_a_switched_off_page_needs_no_port_and_no_browser() -> None:
    off = replace(Config(), page=PageConfig(enabled=False))
    assert asked(ports.page_port, off).level is Level.SKIP
    assert asked(machine.browser, off).level is Level.SKIP

"""`gcs demo` from end to end in a small world, with the tests' tracker; and its end when interrupted."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gcs.demo import DemoOptions, demo
from gcs.demo_simulator import SUMMARY, SimulatorError
from gcs.errors import GcsError
from gcs.operator.terminal import Screen
from gcs.recorder.film_reader import FilmReader
from gcs.recorder.manifest import read_manifest
from tests.gcs.blob_tracker import BlobTracker

pytestmark = pytest.mark.alone  # real flights in real time want the machine to themselves

WORLD = {
    "text": "A red car that drives slowly away from a low hover.",
    "height_m": 4,
    "heading_deg": 0,
    "actors": [
        {"name": "target", "kind": "car", "colour": "red", "start": [12, 1, 0],
         "path": [{"straight_m": 200}], "speed": [[0, 0], [4, 0], [8, 1.5]]}
    ],
}  # fmt: skip


@pytest.fixture
def world(tmp_path: Path) -> Path:
    path = tmp_path / "small.json"
    path.write_text(json.dumps(WORLD))
    return path


def run_demo(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "tests.gcs.run_blob", "demo", *arguments],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


@pytest.mark.slow
def test_the_demo_flies_judges_and_leaves_its_record(tmp_path: Path, world: Path) -> None:
    out = tmp_path / "out"
    process = run_demo("--seconds", "6", "--out", str(out), "--scenario", str(world), "--json")
    said, errors = process.communicate(timeout=100)
    assert process.returncode == 0, errors
    *rest, last = said.splitlines()
    assert rest == []  # one JSON line, the rest is on standard error
    result = json.loads(last)
    assert result["unsafe"] == 0
    assert result["confirmations"] == 1
    assert result["time_on_target_frac"] > 0.9
    assert result["bearing_rms_deg"] < 10
    assert result["max_setpoint_gap_s"] > 0.03  # it is a measurement
    assert json.loads((out / "summary.json").read_text()) == result
    assert (out / "plot.png").stat().st_size > 10_000
    assert (out / "flight.tlog").stat().st_size > 10_000
    assert (out / "messages.jsonl").stat().st_size > 10_000
    manifest = read_manifest(out)
    assert (manifest.kind, manifest.watermark, manifest.follows, manifest.problems) == ("demo", "SIM", 1, ())
    assert manifest.ended is not None
    film = FilmReader(out)
    times_s = [packet.t_arrival_s for packet in film.packets()]
    film.close()
    assert times_s[-1] - times_s[0] > 6


def processes_with(text: str) -> list[int]:
    """Processes whose command line has this text."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                if text.encode() in (entry / "cmdline").read_bytes():
                    found.append(int(entry.name))
            except OSError:
                continue
    return found


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="looks for processes in /proc")
def test_an_interrupted_demo_leaves_no_process_behind(tmp_path: Path, world: Path) -> None:
    out = tmp_path / "out"
    process = run_demo("--out", str(out), "--scenario", str(world))
    assert process.stdout is not None
    for line in process.stdout:
        if "taking off" in line:
            break
    assert len(processes_with(str(out))) == 2
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=30)
    assert process.returncode == 1
    deadline_s = time.monotonic() + 5
    while processes_with(str(out)) and time.monotonic() < deadline_s:
        time.sleep(0.05)
    assert processes_with(str(out)) == []


def test_a_simulator_that_does_not_start_is_one_line(tmp_path: Path) -> None:
    options = DemoOptions(tmp_path, scenario="no-such-world")
    with pytest.raises(SimulatorError, match="no-such-world") as error:
        demo(options, Screen(sys.stderr), lambda config: BlobTracker())
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("seconds", ["0", "nan", "1e9"])
def test_a_length_out_of_range_is_refused(seconds: str, tmp_path: Path) -> None:
    process = run_demo("--seconds", seconds, "--out", str(tmp_path))
    _, errors = process.communicate(timeout=30)
    assert process.returncode == 2
    assert "--seconds" in errors
    assert errors.count("\n") == 1


def test_an_output_folder_that_cannot_be_made_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(GcsError):
        demo(DemoOptions(tmp_path / "file" / "out"), Screen(sys.stderr), lambda config: BlobTracker())


KILLED = """
import asyncio, pathlib, sys
from gcs.demo_simulator import simulator

async def main():
    async with simulator(pathlib.Path(sys.argv[1]), scenario=sys.argv[2], personality="px4", extra=("--fps", "2")):
        print("flying", flush=True)
        await asyncio.sleep(60)

asyncio.run(main())
"""


def test_the_simulator_ends_with_a_demo_that_is_killed(tmp_path: Path, world: Path) -> None:
    command = [sys.executable, "-c", KILLED, str(tmp_path), str(world)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == "flying\n"
        assert not (tmp_path / SUMMARY).exists()
        parent.kill()
    assert parent.returncode == -signal.SIGKILL
    deadline_s = time.monotonic() + 30
    while not (tmp_path / SUMMARY).exists() and time.monotonic() < deadline_s:
        time.sleep(0.05)
    assert (tmp_path / SUMMARY).exists()  # its last act, of its own accord

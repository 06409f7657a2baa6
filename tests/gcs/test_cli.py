from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from gcs.cli import dryrun as cli_dryrun
from gcs.cli import entry as cli
from gcs.config import TrackerConfig as TrackerChoice
from gcs.errors import EXIT_FAULT, EXIT_INTERRUPTED, EXIT_USAGE, VehicleError
from gcs.tracking import BoxTracker
from sitl_mocks import sequences
from tests.gcs.clips import index_first, write_clip
from tests.gcs.colour_tracker import ColourTracker

HEAVY = ("torch", "cv2", "numpy", "mavsdk", "pymavlink", "scipy", "matplotlib", "tqdm", "yaml")


@pytest.fixture
def colour(monkeypatch: pytest.MonkeyPatch) -> None:
    """`gcs dry-run` with the clips' own tracker instead of a network."""

    def factory(choice: TrackerChoice, say: object) -> BoxTracker:
        return ColourTracker()

    monkeypatch.setattr(cli_dryrun, "make_tracker", factory)


def refused(capsys: pytest.CaptureFixture[str], *argv: str) -> str:
    """The one line on stderr of a command that must be refused."""
    status = cli.main(list(argv))
    shown = capsys.readouterr()
    assert status == EXIT_USAGE
    assert shown.out == ""
    lines = shown.err.splitlines()
    assert len(lines) == 1, shown.err
    assert lines[0].startswith("gcs: ")
    return lines[0].removeprefix("gcs: ")


@pytest.mark.parametrize("argv", [["--help"], ["dry-run", "--help"], ["run", "--help"], ["weights", "train", "--help"]])
def test_help_imports_nothing_heavy(argv: list[str]) -> None:
    program = (
        "import sys\nfrom gcs.cli.entry import main\n"
        f"try: main({argv!r})\nexcept SystemExit as e: status = e.code\n"
        f"print('HEAVY', [m for m in {HEAVY!r} if m in sys.modules], status)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "HEAVY [] 0"
    assert "usage: gcs" in done.stdout


def test_every_command_is_there() -> None:
    text = cli.build_parser().format_help()
    assert all(command in text for command in ("run", "dry-run", "demo", "weights", "bench", "config"))


@pytest.mark.parametrize("argv", [[], ["fly"], ["dry-run", "--seconds", "x"], ["weights"], ["demo", "--seed", "1.5"]])
def test_misuse_is_one_line_and_status_2(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main(argv)
    assert caught.value.code == EXIT_USAGE
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.usefixtures("colour")
def test_a_dry_run_ends_with_one_summary_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    clip = write_clip(tmp_path / "a.mp4")
    assert cli.main(["dry-run", str(clip), "--box", "60,90,32,32", "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr()
    summary, note = shown.out.splitlines()
    assert summary.startswith("dry run: 20 frames at ")
    assert "time lost 0.0 of 0.9 s" in summary or "time lost 0.0 of 1.0 s" in summary
    assert "would-be setpoints" in summary
    assert "assume 20 m" in note
    assert "20/20" in shown.err  # the progress bar


@pytest.mark.usefixtures("colour")
def test_json_is_one_line_on_stdout(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    clip = write_clip(tmp_path / "a.mp4")
    out = str(tmp_path / "out")
    assert cli.main(["dry-run", str(clip), "--box", "60,90,32,32", "--out", out, "--json", "--no-video"]) == 0
    line = capsys.readouterr().out
    assert len(line.splitlines()) == 1
    assert json.loads(line)["frames"] == 20


@pytest.mark.usefixtures("colour")
@pytest.mark.skipif(not sequences.names(), reason="the sequences are not recorded yet")
def test_the_sample_brings_its_own_boxes_telemetry_and_lens(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["dry-run", "--sample", "--seconds", "1", "--json", "--out", str(tmp_path)]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["frames"] > 5
    assert summary["accuracy"] is not None
    assert summary["assumed_distance_m"] is None


@pytest.mark.usefixtures("colour")
def test_a_truncated_video_shows_its_summary_and_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = index_first(write_clip(tmp_path / "a.mp4", frames=40))
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(whole.read_bytes()[: int(whole.stat().st_size * 0.5)])
    assert cli.main(["dry-run", str(cut), "--box", "60,90,32,32", "--out", str(tmp_path / "out")]) == EXIT_USAGE
    shown = capsys.readouterr()
    assert shown.out.startswith("dry run: ")
    assert shown.err.splitlines()[-1].startswith(f"gcs: {cut}: truncated, only ")


def test_bad_input_is_one_line_each(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    clip = str(write_clip(tmp_path / "a.mp4"))
    words = tmp_path / "words.mp4"
    words.write_text("only words")
    config = tmp_path / "c.yaml"
    config.write_text("camera:\n  hfov_deg: 999\n")
    empty = tmp_path / "empty"
    empty.mkdir()
    box = ("--box", "60,90,32,32")
    expected = {
        ("dry-run",): "no video",
        ("dry-run", "nowhere.mp4", *box): "nowhere.mp4: no such file",
        ("dry-run", str(words), *box): "words.mp4: not a video",
        ("dry-run", str(empty), *box): "no images",
        ("dry-run", "udp://127.0.0.1:99999", *box): "udp://127.0.0.1:99999: no such address: port out of range",
        ("dry-run", "rtsp://127.0.0.1:1/x", *box): "rtsp://127.0.0.1:1/x",
        ("dry-run", clip, "--box", "1,2,3"): "must be x,y,w,h",
        ("dry-run", clip, "--box", "1,2,3,4"): "under 10 px",
        ("dry-run", clip, "--box", "310,2,30,40"): "outside the frame",
        ("dry-run", clip, *box, "--config", str(config)): "c.yaml:2: camera.hfov_deg: must be from 5 to 170, not 999",
        ("dry-run", clip, *box, "--telemetry", str(words)): "words.mp4:1:",
        ("dry-run", clip, "--boxes", str(tmp_path / "none.txt")): "none.txt: no such file",
        ("dry-run", clip, "--boxes", str(words)): "words.mp4 line 1",
        ("dry-run", clip, *box, "--seconds", "-1"): "--seconds -1",
        ("dry-run", "--sample", "nothing"): "no such sequence",
        ("dry-run", clip, "--sample", "car"): "not both",
        ("dry-run", clip, *box, "--weights", str(words)): "manifest words.json is missing",
        ("dry-run", clip, *box, "--weights", "gigantic"): "no shipped weights of that name",
        ("config", str(config)): "c.yaml:2",
        ("weights", "info", "gigantic"): "no such weights file",
        ("weights", "import", str(words), "--out", str(tmp_path / "w.safetensors")): "words.mp4",
        ("weights", "import", str(words), "--out", "w.pth"): "must end in .safetensors",
        ("weights", "import", str(words), "--out", "w.safetensors", "--network", "huge"): "known are full, compact",
        ("weights", "train", str(words), "--data", "x", "--out", "y"): "must be a list",
        ("bench", "track", str(tmp_path / "none")): "no such folder",
    }
    for argv, words_of_it in expected.items():
        line = refused(capsys, *argv)
        assert words_of_it.lower() in line.lower(), (argv, line)


def test_corrupt_weights_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from tracker.configs import COMPACT
    from tracker.network.climrt import ClimRT
    from tracker.weights import save

    path = save(tmp_path / "w.safetensors", ClimRT(COMPACT))
    assert cli.main(["weights", "info", str(path)]) == 0
    assert "compact" in capsys.readouterr().out
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    clip = str(write_clip(tmp_path / "a.mp4"))
    line = refused(capsys, "dry-run", clip, "--box", "60,90,32,32", "--weights", str(path))
    assert "sha256" in line


def test_the_real_network_runs_through_the_whole_chain(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Untrained weights: nothing is said of accuracy, only that every part fits the next."""
    from tracker.configs import COMPACT
    from tracker.network.climrt import ClimRT
    from tracker.weights import save

    path = save(tmp_path / "w.safetensors", ClimRT(COMPACT))
    config = tmp_path / "c.yaml"
    config.write_text("tracker:\n  latent: off\n  latent_interval: 2\n")
    clip = str(write_clip(tmp_path / "a.mp4", frames=6))
    argv = ["dry-run", clip, "--box", "60,90,32,32", "--weights", str(path), "--config", str(config)]
    assert cli.main([*argv, "--out", str(tmp_path / "out"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 6


def test_the_configuration_is_printed_and_checked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["config"]) == 0
    path = tmp_path / "c.yaml"
    path.write_text(capsys.readouterr().out)
    assert cli.main(["config", str(path)]) == 0
    assert capsys.readouterr().out == f"{path}: good\n"


def raising(error: BaseException) -> object:
    def handler(args: object) -> int:
        raise error

    return lambda name: handler


@pytest.mark.parametrize(
    ("error", "line", "status"),
    [
        (VehicleError("vehicle refused to arm: pre-arm check"), "vehicle refused to arm: pre-arm check", EXIT_USAGE),
        (VehicleError("two\nlines \x1b[31m"), "two lines  [31m", EXIT_USAGE),
        (KeyboardInterrupt(), "interrupted", EXIT_INTERRUPTED),
        (PermissionError(13, "Permission denied", "/x"), "/x: Permission denied", EXIT_USAGE),
        (ZeroDivisionError("oh"), "internal fault, ZeroDivisionError: oh; --debug shows where", EXIT_FAULT),
        (ValueError("oh"), "internal fault, ValueError: oh; --debug shows where", EXIT_FAULT),
    ],
)
def test_whatever_goes_wrong_is_one_line(
    error: BaseException, line: str, status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cli, "_load", raising(error))
    assert cli.main(["demo"]) == status
    assert capsys.readouterr().err == f"gcs: {line}\n"


@pytest.mark.parametrize("argv", [["--debug", "demo"], ["demo", "--debug"]])
def test_debug_shows_the_traceback(argv: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cli, "_load", raising(ZeroDivisionError("oh")))
    with pytest.raises(ZeroDivisionError):
        cli.main(argv)


def test_run_and_demo_hand_their_arguments_on(monkeypatch: pytest.MonkeyPatch) -> None:
    got: list[SimpleNamespace] = []

    def load(name: str) -> object:
        def handler(args: SimpleNamespace) -> int:
            got.append(SimpleNamespace(**{**vars(args), "handler": name}))
            return 0

        return handler

    monkeypatch.setattr(cli, "_load", load)
    run = ["run", "--video", "udp://:5600", "--vehicle", "udpin://0.0.0.0:14540", "--box", "1,2,30,40"]
    assert cli.main([*run, "--autopilot", "px4", "--timeout", "5", "--out", "o"]) == 0
    assert cli.main(["demo", "--seconds", "20", "--scenario", "walk", "--seed", "3", "--personality", "px4"]) == 0
    first, second = got
    assert (first.handler, first.video, first.timeout, first.autopilot) == (
        "gcs.launch:main",
        "udp://:5600",
        5.0,
        "px4",
    )
    assert (second.handler, second.seconds, second.seed, second.json) == ("gcs.demo:main", 20.0, 3, False)

"""The verdict of `gcs replay --verify` claims no more than was done: what is missing, damaged or other is told."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec
import pytest

from gcs.cli.entry import main
from gcs.recorder.film_index import INDEX
from gcs.recorder.flight_recorder import MESSAGES
from gcs.recorder.folder import FlightFolder
from gcs.recorder.manifest import VideoFacts, read_manifest, write_manifest
from gcs.replay.film import Film
from gcs.verify import verify as module
from gcs.verify.verify import Recorded, Start, Verdict, track_again, verify
from gcs.video.frame import Image
from tests.gcs import replay_rig
from tests.gcs.verify_rig import record_flight
from tests.replay.golden import GOLDEN, unpack
from tracker.box import Box, TrackResult

ENDED = "2026-01-01T00:00:09Z"


def quiet(text: str) -> None:
    """No progress is shown."""


@dataclass
class Loaded:
    """What a tracker tells of its weights."""

    sha256: str


class Still:
    """A tracker without a network: its box stays where it was drawn."""

    def __init__(self, sha256: str) -> None:
        self.loaded = Loaded(sha256)
        self.box = Box(0.0, 0.0, 1.0, 1.0)

    def init(self, frame_bgr: Image, box: Box) -> None:
        self.box = box

    def update(self, frame_bgr: Image) -> TrackResult:
        return TrackResult(self.box, 0.5, 0.5)

    def look_at(self, cx_px: float, cy_px: float) -> None:
        """It does not look."""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Without a film."""
    folder = tmp_path_factory.mktemp("flown")
    record_flight(folder)
    changed(folder, ended=ENDED)
    return folder


@pytest.fixture(scope="module")
def in_jpeg(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As a camera of this machine is filmed."""
    folder = replay_rig.record_flight(tmp_path_factory.mktemp("jpeg"))
    changed(folder, video=VideoFacts("camera:0", *replay_rig.SIZE, 20.0))
    return folder


@pytest.fixture
def copied(flown: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(flown, tmp_path / "flight"))


@pytest.fixture
def golden(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A flight with a film as it was tracked, and a quick tracker instead of its own."""
    pytest.importorskip("av")
    folder = unpack(GOLDEN / "px4", tmp_path / "golden")
    facts = read_manifest(folder).weights
    assert facts is not None
    monkeypatch.setattr(module, "make_tracker", lambda config: Still(facts.sha256))
    return folder


def changed(folder: Path, **values: object) -> None:
    write_manifest(folder, msgspec.structs.replace(read_manifest(folder), **values))


def index_lines(folder: Path, change: Callable[[list[bytes]], None]) -> None:
    lines = (folder / INDEX).read_bytes().splitlines(keepends=True)
    change(lines)
    (folder / INDEX).write_bytes(b"".join(lines))


def notes(verdict: Verdict) -> str:
    return "\n".join(line for line in verdict.lines() if line.startswith("note: "))


def test_a_whole_record_has_no_notes(flown: Path) -> None:
    verdict = verify(flown, Start.CONTROL, quiet)
    assert (verdict.exact, verdict.whole, verdict.problems) == (True, True, ())


@pytest.mark.parametrize(
    ("values", "note"),
    [
        ({"problems": ("flight.tlog: no space left on device",)}, "note: flight.tlog: no space left on device"),
        ({"dropped": 7}, "note: 7 records of the flight were not written in time"),
        ({"ended": None}, "note: the flight was not ended in order"),
    ],
)
def test_what_the_manifest_knows_is_told(copied: Path, values: dict[str, object], note: str) -> None:
    changed(copied, **values)
    verdict = verify(copied, Start.CONTROL, quiet)
    assert verdict.exact
    assert note in notes(verdict)
    assert len(verdict.problems) == 1


def test_a_log_that_was_cut_is_told(copied: Path) -> None:
    written = (copied / MESSAGES).read_bytes()
    (copied / MESSAGES).write_bytes(written[: len(written) // 2])
    verdict = verify(copied, Start.CONTROL, quiet)
    assert verdict.exact
    assert "note: the last line of the log is cut off" in notes(verdict)


def test_a_line_whose_values_cannot_be_is_told(copied: Path) -> None:
    lines = (copied / MESSAGES).read_bytes().splitlines(keepends=True)
    at = next(at for at in reversed(range(len(lines))) if b'"type":"Tick"' in lines[at])
    row = msgspec.json.decode(lines[at])
    row["data"]["gate"] = 5
    lines[at] = msgspec.json.encode(row) + b"\n"
    (copied / MESSAGES).write_bytes(b"".join(lines))
    assert "note: 1 lines of the log cannot be read" in notes(verify(copied, Start.CONTROL, quiet))


def test_a_flight_in_progress_is_told_once(copied: Path) -> None:
    changed(copied, ended=None)
    written = (copied / MESSAGES).read_bytes()
    (copied / MESSAGES).write_bytes(written[: len(written) // 2])
    folder = FlightFolder(copied)
    (problem,) = verify(copied, Start.CONTROL, quiet).problems
    folder.close()
    assert "still being recorded" in problem


def test_a_damaged_line_of_the_index_costs_its_picture_alone(golden: Path) -> None:
    index_lines(golden, lambda lines: lines.insert(5, b'{"type":"pack\n'))  # no packet is lost
    verdict = verify(golden, Start.TRACKER, quiet)
    assert verdict.tracked == verdict.compared["FrameRecord"] > 400
    assert verdict.whole
    assert "1 of its lines cannot be read" in notes(verdict)
    assert not any("could be tracked again" in line for line in verdict.lines())


def test_where_a_picture_is_missing_nothing_is_proved(golden: Path, capsys: pytest.CaptureFixture[str]) -> None:
    index_lines(golden, lambda lines: lines.__setitem__(200, b"damaged\n"))
    assert main(["replay", str(golden), "--verify"]) == 1
    out = capsys.readouterr().out
    assert "the film does not hold the picture" in out
    assert "1 of its lines cannot be read" in out
    assert ": use --from control\n" in out
    verdict = verify(golden, Start.TRACKER, quiet)
    assert 150 < verdict.tracked < verdict.compared["FrameRecord"]
    assert (verdict.whole, verdict.equal, verdict.exact) == (False, False, False)


def test_a_record_that_does_not_tell_how_it_was_tracked_proves_nothing(golden: Path) -> None:
    rows = [msgspec.json.decode(line) for line in (golden / MESSAGES).read_bytes().splitlines()]
    for row in rows:
        row["data"].pop("told", None)
    (golden / MESSAGES).write_bytes(b"".join(msgspec.json.encode(row) + b"\n" for row in rows))
    verdict = verify(golden, Start.TRACKER, quiet)
    assert (verdict.tracked, verdict.whole, verdict.exact) == (0, False, False)
    assert "does not tell of each picture" in notes(verdict)


def test_a_film_of_jpeg_is_not_tracked_again(in_jpeg: Path, capsys: pytest.CaptureFixture[str]) -> None:
    reason = "the film is JPEG, not what was tracked: use --from control"
    recorded = Recorded.open(in_jpeg)
    assert track_again(recorded, recorded.config, quiet) == ({}, reason)
    assert main(["replay", str(in_jpeg), "--verify"]) == 1
    out = capsys.readouterr().out
    assert f"note: {reason}" in out
    assert "fingerprint" not in out


def test_other_weights_and_code_are_named_and_allow_nothing(golden: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    changed(golden, software={**read_manifest(golden).software, "code": "0" * 64})
    before = verify(golden, Start.TRACKER, quiet)
    assert [each.split()[0] for each in before.others] == ["code"]
    monkeypatch.setattr(module, "make_tracker", lambda config: Still("f" * 64))
    verdict = verify(golden, Start.TRACKER, quiet)
    assert [each.split()[0] for each in verdict.others] == ["code", "weights"]
    assert verdict.elsewhere == before.elsewhere
    assert any(line.startswith("other than in the flight: weights ffffffffffff, was ") for line in verdict.lines())


def test_other_code_leaves_the_tolerance_as_it_is(copied: Path) -> None:
    software = {**read_manifest(copied).software, "code": "0" * 64}
    changed(copied, software=software)
    verdict = verify(copied, Start.CONTROL, quiet)
    assert verdict.exact
    assert verdict.elsewhere == ()
    (other,) = verdict.others
    assert other.startswith("code ")
    assert other.endswith(", was 000000000000")


@pytest.mark.parametrize(
    "pair", [("--verify", "--with", "x.yaml"), ("--verify", "--film", "x.mp4"), ("--with", "x.yaml", "--film", "x.mp4")]
)
def test_one_thing_at_a_time(flown: Path, pair: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["replay", str(flown), *pair])
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "not allowed with argument" in line


def test_an_annotated_film_in_the_folder_of_a_flight_is_not_its_film(in_jpeg: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(in_jpeg, tmp_path / "flight"))
    assert main(["replay", str(folder), "--film", str(folder / "annotated.mp4")]) == 0
    film = Film(folder)
    assert film.is_there
    assert not film.is_annotated
    film.close()
    (folder / INDEX).unlink()
    film = Film(folder)
    assert film.is_annotated
    film.close()

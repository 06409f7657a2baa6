"""`gcs bench track` and `gcs bench score`, with a tracker that needs no network."""

import json
from pathlib import Path

import numpy as np
import pytest

from gcs.cli import entry as cli
from gcs.errors import EXIT_USAGE
from gcs.pixel_kalman import PixelKalman
from tests.tracker.eval_sets import MovingTracker, sequence_folder, truth, write_boxes
from tracker.box import Box

SHARED_EVAL = Path(__file__).parents[3] / "shared" / "data" / "eval"


@pytest.fixture
def dataset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("tracker.eval.run.Shipped.__call__", lambda self: MovingTracker())
    for name, count in (("a", 4), ("b", 8)):
        sequence_folder(tmp_path / "set", name, count)
    return tmp_path / "set"


def refused(capsys: pytest.CaptureFixture[str], *argv: str) -> str:
    assert cli.main(["bench", *argv]) == EXIT_USAGE
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1, lines
    return lines[0]


def test_track_ends_with_the_mean(dataset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["bench", "track", str(dataset), "--json"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [row["sequence"] for row in rows] == ["a", "b", "mean"]
    assert rows[-1]["precision"] == 1
    assert {"auc", "auc_valid", "precision_valid", "fps"} <= set(rows[-1])


def test_track_against_others_with_everything(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_boxes(tmp_path / "other" / "a.txt", truth(4), "\t")
    write_boxes(tmp_path / "other" / "b.txt", truth(8) + 1, " ")
    argv = ["bench", "track", str(dataset), "--results", str(tmp_path / "ours"), "--against", f"Other={tmp_path}/other"]
    argv += ["--attributes", "--plots", str(tmp_path / "plots"), "--latency", "--fps", "30"]
    assert cli.main(argv) == 0
    shown = capsys.readouterr().out
    assert "ClimRT (2)" in shown
    assert "Other (2)" in shown
    assert "frames skipped" in shown
    assert "has none on disk" in shown
    assert (tmp_path / "plots" / "cle_a.png").is_file()
    assert np.loadtxt(tmp_path / "ours" / "b.txt", delimiter=",").shape == (8, 4)


def test_twelve_starts_their_mean_and_deviation(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = ["bench", "track", str(dataset), "--sre", "--results", str(tmp_path / "ours")]
    assert cli.main([*argv, "--json"]) == 0
    *rows, last = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert len({row["start"] for row in rows}) == len(rows) == 12
    assert (last["start"], last["starts"]) == ("mean", 12)
    assert last["auc"] == pytest.approx(np.mean([row["auc"] for row in rows]), abs=1e-4)
    assert last["std"]["auc"] == pytest.approx(np.std([row["auc"] for row in rows]), abs=2e-4)
    assert (tmp_path / "ours" / "up-left" / "b.txt").is_file()
    assert cli.main(argv) == 0  # from what is kept
    shown = capsys.readouterr().out
    assert "scale-1.2" in shown
    assert "mean (12 starts)" in shown
    assert "standard deviation" in shown
    (dataset / "a" / "groundtruth.txt").write_text("1,2,3\n")
    assert cli.main(argv) == EXIT_USAGE
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_start_that_cannot_be_tracked_is_told_and_counts_in_no_mean(
    dataset: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    begin = MovingTracker.init

    def init(self: MovingTracker, frame_bgr: object, box: Box) -> None:
        if abs(box.w_px - 0.8 * truth(4)[0, 2]) < 1e-6:
            raise ValueError("box: too small")
        begin(self, frame_bgr, box)

    monkeypatch.setattr(MovingTracker, "init", init)
    assert cli.main(["bench", "track", str(dataset), "--sre"]) == EXIT_USAGE
    shown = capsys.readouterr()
    assert "scale-0.8" not in shown.out
    assert "mean (12" not in shown.out  # neither sequence was scored from all of them
    assert shown.out.count("sequence  ") == 1
    told = [line for line in shown.err.splitlines() if line.startswith("gcs: ")]
    assert [line.rsplit(": ", 1)[1] for line in told] == ["too small (start scale-0.8)"] * 2


def test_a_broken_sequence_is_reported_at_the_end(dataset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (dataset / "a" / "groundtruth.txt").write_text("1,2,3\n")
    assert cli.main(["bench", "track", str(dataset), "--json"]) == EXIT_USAGE
    shown = capsys.readouterr()
    assert json.loads(shown.out.splitlines()[-1])["sequences"] == 1
    assert shown.err.splitlines()[-1] == (
        f"gcs: {dataset / 'a' / 'groundtruth.txt'} line 1: 3 values where x,y,w,h are wanted"
    )


def test_bad_arguments_are_one_line(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    d = str(dataset)
    assert "must be NAME=DIR" in refused(capsys, "track", d, "--against", "x")
    assert "must be 1 or more" in refused(capsys, "track", d, "--jobs", "0")
    assert "--sre goes without" in refused(capsys, "track", d, "--sre", "--latency")
    assert "belong to --latency" in refused(capsys, "track", d, "--fps", "30")
    assert "must be above zero" in refused(capsys, "track", d, "--latency", "--slower", "0")
    assert "none of index, uav123" in refused(capsys, "track", d, "--dataset", "imagenet")
    assert "no sequences in the layout 'otb'" in refused(capsys, "track", d, "--dataset", "otb")
    assert "no such folder of results" in refused(capsys, "score", d, "--results", f"A={tmp_path}/none")
    assert "no such folder" in refused(capsys, "track", str(tmp_path / "none"))


def test_weights_that_do_not_ship_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    sequence_folder(tmp_path / "set", "a", 4)
    line = refused(capsys, "track", str(tmp_path / "set"), "--weights", str(tmp_path / "none.safetensors"))
    assert "no such weights file" in line
    line = refused(capsys, "track", str(tmp_path / "set"), "--weights", "compact", "--config", "full")
    assert line == "gcs: compact: holds the network 'compact', not 'full'"
    monkeypatch.setattr("tracker.weights.DATA", tmp_path)
    line = refused(capsys, "track", str(tmp_path / "set"), "--config", "full")
    assert "full: no shipped weights of that name" in line


@pytest.mark.skipif(not SHARED_EVAL.exists(), reason="the published boxes are not on this machine")
def test_published_figures_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    boxes = SHARED_EVAL / "boxes"
    argv = ["--results", f"AutoTrack={boxes / 'AutoTrack'}", "--results", f"BACF={boxes / 'BACF'}"]
    assert cli.main(["bench", "score", str(SHARED_EVAL / "uav123_10fps"), *argv]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()[1:]]
    assert lines[0] == ["AutoTrack", "(123)", "0.4774", "0.6714", "|", "0.4821", "0.6540"]
    assert lines[1][:4] == ["BACF", "(123)", "0.4130", "0.5721"]


def test_the_pixel_filter_predicts_constant_motion() -> None:
    kalman = PixelKalman()
    with pytest.raises(ValueError, match="before the first box"):
        kalman.predict(0.0)
    for k in range(20):
        kalman.observe(k / 10, np.array([5.0 * k, 100 - 2.0 * k, 30, 40]))
    np.testing.assert_allclose(kalman.predict(2.2), [110, 56, 30, 40], atol=0.5)
    before = kalman.predict(2.2)
    kalman.predict(9.0)
    np.testing.assert_array_equal(kalman.predict(2.2), before)

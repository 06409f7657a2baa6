"""`gcs weights export`: what it writes runs, and what it cannot do is one line."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs.cli import entry as cli
from tests.tracker.conftest import random_network
from tracker.engines.engine import EngineError
from tracker.engines.export_files import read_graphs
from tracker.weights import load_tracker, save


@pytest.fixture
def weights(tmp_path: Path) -> str:
    return str(save(tmp_path / "tiny.safetensors", random_network()))


def refused(capsys: pytest.CaptureFixture[str], *argv: str) -> str:
    assert cli.main(["weights", "export", *argv]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    return err


def video(path: Path) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10, (160, 120))
    for i in range(5):
        writer.write(np.random.default_rng(i).integers(0, 256, (120, 160, 3), np.uint8))
    writer.release()
    path.with_suffix(".txt").write_text("60,40,20,20\n" * 5)


def test_written_graphs_are_the_weights(weights: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "graphs"
    assert cli.main(["weights", "export", weights, "--out", str(out)]) == 0
    graphs = read_graphs(out)
    assert (graphs.network.name, graphs.precision, set(graphs.embed)) == ("tiny", "f32", {127, 287})
    said = capsys.readouterr().out
    manifest = json.loads((out / "export.json").read_text())
    assert manifest["weights_sha256"] == json.loads((tmp_path / "tiny.json").read_text())["sha256"]
    assert all(name in said for name in ("export.json", *manifest["files"]))


@pytest.mark.skipif(find_spec("openvino") is None, reason="openvino is not installed")
def test_openvino_form(weights: str, tmp_path: Path) -> None:
    assert cli.main(["weights", "export", weights, "--to", "openvino", "--out", str(tmp_path / "ir")]) == 0
    assert {path.suffix for path in (tmp_path / "ir").iterdir()} == {".xml", ".bin", ".json"}


@pytest.mark.skipif(find_spec("onnxruntime") is None or find_spec("onnx") is None, reason="needs onnxruntime and onnx")
def test_eight_bits_from_footage(weights: str, tmp_path: Path) -> None:
    video(tmp_path / "a.mp4")
    argv = [weights, "--out", str(tmp_path / "q"), "--int8", "--frames", str(tmp_path / "a.mp4"), "--patches", "4"]
    assert cli.main(["weights", "export", *argv]) == 0
    assert read_graphs(tmp_path / "q").precision == "int8"
    manifest = json.loads((tmp_path / "q" / "export.json").read_text())
    assert manifest["calibration"] == {"layers": 2, "method": "percentile", "patches": 5, "videos": ["a.mp4"]}


def test_refusals_are_one_line(weights: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = ("--out", str(tmp_path / "x"))
    assert "--int8 and --frames belong together" in refused(capsys, weights, *out, "--int8")
    assert "--int8 and --frames belong together" in refused(capsys, weights, *out, "--frames", "a.mp4")
    assert "no shipped weights of that name" in refused(capsys, "gigantic", *out)
    assert "no such weights file" in refused(capsys, str(tmp_path / "none.safetensors"), *out)
    (tmp_path / "taken").write_text("")
    assert "taken: " in refused(capsys, weights, "--out", str(tmp_path / "taken"))
    int8 = (weights, *out, "--int8", "--frames")
    assert "none.txt: no such file of boxes" in refused(capsys, *int8, str(tmp_path / "none.mp4"))
    video(tmp_path / "a.mp4")
    assert "--patches 0: must be 1 or more" in refused(capsys, *int8, str(tmp_path / "a.mp4"), "--patches", "0")
    assert "--layers 6: must be in 1..5" in refused(capsys, *int8, str(tmp_path / "a.mp4"), "--layers", "6")
    (tmp_path / "a.mp4").write_bytes(b"no video")
    assert "not a video that can be read" in refused(capsys, *int8, str(tmp_path / "a.mp4"))
    damaged = Path(weights)
    damaged.write_bytes(damaged.read_bytes()[:-1] + b"?")
    assert "sha256 is not the manifest's" in refused(capsys, weights, *out)


@pytest.mark.skipif(find_spec("onnxruntime") is None, reason="onnxruntime is not installed")
def test_what_is_exported_tracks(weights: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, clip, config = tmp_path / "graphs", tmp_path / "a.mp4", tmp_path / "c.yaml"
    video(clip)
    assert cli.main(["weights", "export", weights, "--out", str(out)]) == 0
    config.write_text(f"tracker: {{weights: {weights}, engine: onnxruntime, graphs: {out}, threads: 1}}\n")
    argv = ["dry-run", str(clip), "--boxes", str(clip.with_suffix(".txt")), "--config", str(config), "--json"]
    assert cli.main([*argv, "--out", str(tmp_path / "dry")]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["frames"] == 5
    save(tmp_path / "tiny.safetensors", random_network(seed=3))  # other weights under the same name
    assert cli.main([*argv, "--out", str(tmp_path / "other")]) == 2
    assert "was exported from other weights" in capsys.readouterr().err


def test_the_reference_engine_runs_no_graphs(weights: str, tmp_path: Path) -> None:
    assert cli.main(["weights", "export", weights, "--out", str(tmp_path / "graphs")]) == 0
    with pytest.raises(EngineError, match="engine torch: runs no exported graphs"):
        load_tracker(weights, graphs=tmp_path / "graphs")

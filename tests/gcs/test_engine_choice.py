from __future__ import annotations

import json
from pathlib import Path

import pytest

from gcs.config import EngineName, Latent, TrackerConfig
from gcs.engine_choice import choice, memory
from gcs.engine_choice.choice import choose, choose_anew, chosen
from gcs.engine_choice.measure import Candidate, Measured, measure
from tests.tracker.conftest import random_network
from tracker.engines.engine import EngineError
from tracker.weights import WeightsError, save

SCORES = {("full", None): 0.7, ("compact", None): 0.5, ("compact", "climnet"): 0.6}


def timed(weights: str, threads: int, update_ms: float, latent: str | None = None, engine: str = "torch") -> Measured:
    return Measured(Candidate(weights, engine, threads, latent), update_ms, update_ms)


ALL = [
    timed("full", 1, 90.0),
    timed("full", 2, 45.0),
    timed("compact", 1, 40.0, "climnet"),
    timed("compact", 2, 24.0, "climnet"),
    timed("compact", 1, 12.0),
    timed("compact", 1, 9.0, engine="openvino"),
    timed("compact", 2, 6.0, engine="openvino"),
]


@pytest.mark.parametrize(
    ("fps", "wanted"),
    [
        (5.0, ("full", 1)),
        (10.0, ("full", 2)),
        (12.0, ("compact", 1)),  # with ClimNet
        (20.0, ("compact", 2)),
        (30.0, ("compact", 1)),
    ],
)
def test_the_best_that_keeps_up_on_the_fewest_threads(fps: float, wanted: tuple[str, int]) -> None:
    found = choose(ALL, fps, SCORES).candidate
    assert (found.weights, found.threads) == wanted
    assert found.latent == ("climnet" if fps in (12.0, 20.0) else None)


def test_of_those_that_cost_about_the_same_the_first() -> None:
    near = [timed("compact", 1, 11.0, engine="onnxruntime"), timed("compact", 1, 10.0, engine="openvino")]
    assert choose(near, 30.0, SCORES) == near[0]
    assert choose(near[::-1], 30.0, SCORES) == near[1]


def test_of_equals_the_fastest() -> None:
    assert choose(ALL, 30.0, SCORES) == timed("compact", 1, 9.0, engine="openvino")
    assert choose(ALL, 80.0, SCORES) == timed("compact", 2, 6.0, engine="openvino")


def test_where_nothing_keeps_up_the_fastest() -> None:
    assert choose(ALL, 240.0, SCORES) == timed("compact", 2, 6.0, engine="openvino")
    with pytest.raises(ValueError, match="no way to track"):
        choose([], 30.0, SCORES)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("CLIMRT_CACHE", str(tmp_path))
    return tmp_path / "engines.json"


@pytest.fixture
def measurements(monkeypatch: pytest.MonkeyPatch) -> list[Candidate]:
    """Of each candidate, instead of a real measurement: the more threads, the faster."""
    asked: list[Candidate] = []

    def quick(candidate: Candidate) -> Measured:
        asked.append(candidate)
        if candidate.engine == "onnxruntime":
            raise EngineError("engine onnxruntime: broken")
        return Measured(candidate, 20.0 / candidate.threads, 20.0)

    monkeypatch.setattr(choice, "measure", quick)
    monkeypatch.setattr("tracker.engines.catalogue.available_engines", lambda: ["torch", "onnxruntime"])
    monkeypatch.setattr(choice, "usable_cores", lambda: 2)
    return asked


def test_it_is_measured_once_and_said(cache: Path, measurements: list[Candidate]) -> None:
    said: list[str] = []
    found = chosen(TrackerConfig(fps=20.0), said.append)
    assert (found.weights, found.engine, found.threads, found.latent) == ("compact", EngineName.TORCH, 1, None)
    assert len(measurements) == 4
    assert "measuring 4 ways" in said[0]
    assert "onnxruntime, 1 thread does not run here" in said[1]
    assert said[-1] == "tracker: compact on torch, 1 thread: 20.0 ms a picture here (50 pictures a second at most)"
    again = chosen(TrackerConfig(fps=40.0), said.append)
    assert again.threads == 2
    assert len(measurements) == 4
    measured, best = choose_anew(TrackerConfig(), said.append)
    assert len(measurements) == 8
    assert [each.candidate.threads for each in measured] == [1, 2]
    assert best == measured[1]


def test_what_the_configuration_says_is_kept(cache: Path, measurements: list[Candidate]) -> None:
    fixed = TrackerConfig(weights="compact", engine=EngineName.OPENVINO, threads=3)
    assert chosen(fixed, lambda _: None) == fixed
    assert measurements == []
    found = chosen(TrackerConfig(threads=2, latent=Latent.OFF, engine=EngineName.TORCH), lambda _: None)
    assert (found.threads, found.latent) == (2, Latent.OFF)
    assert measurements == [Candidate("compact", "torch", 2, "off")]


def test_another_version_measures_anew(
    cache: Path, measurements: list[Candidate], monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen(TrackerConfig(), lambda _: None)
    monkeypatch.setattr(memory.metadata, "version", lambda name: "99")
    chosen(TrackerConfig(), lambda _: None)
    assert len(measurements) == 8
    assert len(json.loads(cache.read_text())["measured"]) == 2


@pytest.mark.parametrize("text", ["", "{", '{"measured": {"a": 1}}', "[1]", "\x00" * 99])
def test_a_damaged_memory_is_none(cache: Path, measurements: list[Candidate], text: str) -> None:
    cache.write_text(text)
    chosen(TrackerConfig(), lambda _: None)
    assert len(measurements) == 4
    assert len(memory.remembered()) == 2


def test_a_memory_that_cannot_be_written_is_said(
    tmp_path: Path, measurements: list[Candidate], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("CLIMRT_CACHE", str(tmp_path / "file"))
    assert chosen(TrackerConfig(), lambda _: None).weights == "compact"
    assert "not remembered" in caplog.text


def test_bad_weights_are_told_at_once_and_not_engine_by_engine(cache: Path, tmp_path: Path) -> None:
    said: list[str] = []
    with pytest.raises(WeightsError, match="no such weights file"):
        chosen(TrackerConfig(weights=str(tmp_path / "none.safetensors")), said.append)
    assert not any("does not run" in line for line in said)


def test_where_no_engine_runs_it_is_one_line(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(candidate: Candidate) -> Measured:
        raise RuntimeError("illegal instruction")

    monkeypatch.setattr(choice, "measure", broken)
    with pytest.raises(EngineError, match="none of the"):
        chosen(TrackerConfig(), lambda _: None)


def test_the_real_one_is_timed() -> None:
    found = measure(Candidate("compact", "torch", 1, None))
    assert 0 < found.update_ms < 5000
    assert found.cpu_ms > 0


@pytest.mark.parametrize(
    "metrics", [None, [1], {"development_auc": "high"}, {"development_auc_by_latent": {"dream": 1}}]
)
def test_a_manifest_with_strange_scores_is_flown_as_it_says(
    cache: Path, measurements: list[Candidate], tmp_path: Path, metrics: object
) -> None:
    path = save(tmp_path / "w.safetensors", random_network(), {"metrics": metrics})
    found = chosen(TrackerConfig(weights=str(path), engine=EngineName.TORCH), lambda _: None)
    assert (found.weights, found.latent) == (str(path), None)

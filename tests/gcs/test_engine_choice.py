from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from gcs.config import EngineName, Latent, TrackerConfig
from gcs.engine_choice import choice, memory
from gcs.engine_choice.choice import choose, choose_anew, chosen
from gcs.engine_choice.measure import Candidate, Measured, measure
from gcs.tracking import make_tracker
from tests.tracker.conftest import random_network
from tracker.engines.engine import EngineError
from tracker.online import ClimRTTracker
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
    assert len(measurements) == 3  # an engine that fails once is not asked again
    assert "measuring 4 ways" in said[0]
    assert "onnxruntime, 1 thread does not run here" in said[1]
    assert said[-1] == "tracker: compact on torch, 1 thread: 20.0 ms a picture here (50 pictures a second at most)"
    again = chosen(TrackerConfig(fps=40.0), said.append)
    assert again.threads == 2
    assert len(measurements) == 4  # it may be mended by now
    measured, best = choose_anew(TrackerConfig(), said.append)
    assert len(measurements) == 7
    assert [each.candidate.threads for each in measured] == [1, 2]
    assert best == measured[1]


def test_what_the_configuration_says_is_kept(cache: Path, measurements: list[Candidate]) -> None:
    fixed = TrackerConfig(weights="compact", engine=EngineName.OPENVINO, threads=3)
    assert chosen(fixed, lambda _: None) == fixed
    assert measurements == []
    found = chosen(TrackerConfig(threads=2, latent=Latent.OFF, engine=EngineName.TORCH), lambda _: None)
    assert (found.threads, found.latent) == (2, Latent.OFF)
    assert measurements == [Candidate("compact", "torch", 2, "off")]


def test_what_is_not_known_yet_is_measured_beside_what_is(cache: Path, measurements: list[Candidate]) -> None:
    pinned = chosen(TrackerConfig(threads=1, engine=EngineName.TORCH), lambda _: None)
    assert pinned.threads == 1
    assert [(each.engine, each.threads) for each in measurements] == [("torch", 1)]
    found = chosen(TrackerConfig(fps=40.0), lambda _: None)  # 20 ms on one thread, 10 on two
    assert found.threads == 2
    assert ("torch", 2) in [(each.engine, each.threads) for each in measurements]
    assert [(each.engine, each.threads) for each in measurements].count(("torch", 1)) == 1


def test_weights_that_were_trained_on_are_measured_anew(
    cache: Path, measurements: list[Candidate], tmp_path: Path
) -> None:
    for seed in (1, 2):
        torch.manual_seed(seed)
        path = save(tmp_path / "mine.safetensors", random_network(seed=seed))
        for _ in range(2):
            chosen(TrackerConfig(weights=str(path), engine=EngineName.TORCH, fps=5.0), lambda _: None)
    assert len(measurements) == 4  # one and two threads, twice


@pytest.mark.parametrize("update_ms", [0.0, -1.0])
def test_a_time_that_cannot_be_is_not_known(cache: Path, measurements: list[Candidate], update_ms: float) -> None:
    memory.remember([Measured(Candidate("compact", "torch", 1, None), update_ms, 5.0)])
    assert chosen(TrackerConfig(fps=20.0), lambda _: None).threads == 1
    assert len(measurements) == 3


def test_without_a_home_it_is_measured_each_time(
    measurements: list[Candidate], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    for name in ("CLIMRT_CACHE", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)

    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(memory.Path, "home", homeless)
    assert chosen(TrackerConfig(), lambda _: None).weights == "compact"
    assert "not remembered" in caplog.text


def test_what_was_best_and_no_longer_runs_is_replaced(
    cache: Path, measurements: list[Candidate], monkeypatch: pytest.MonkeyPatch
) -> None:
    memory.remember([Measured(Candidate("compact", name, 1, None), 5.0, 5.0) for name in ("onnxruntime", "torch")])
    monkeypatch.setattr("tracker.engines.catalogue.available_engines", lambda: ["onnxruntime", "torch"])

    def broken(*args: object) -> object:
        raise ImportError("no such library")

    monkeypatch.setattr("tracker.engines.onnxruntime.ONNXRuntimeEngine._compile", broken)
    said: list[str] = []
    tracker = make_tracker(TrackerConfig(), said.append)
    assert isinstance(tracker, ClimRTTracker)
    assert tracker.loaded is not None
    assert tracker.loaded.engine == "torch"
    assert any("no longer runs" in line for line in said)
    with pytest.raises(EngineError, match="no such library"):
        make_tracker(TrackerConfig(weights="compact", engine=EngineName.ONNXRUNTIME, threads=1), said.append)


def test_another_version_measures_anew(
    cache: Path, measurements: list[Candidate], monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen(TrackerConfig(), lambda _: None)
    monkeypatch.setattr(memory.metadata, "version", lambda name: "99")
    chosen(TrackerConfig(), lambda _: None)
    assert len(measurements) == 6
    assert len(json.loads(cache.read_text())["measured"]) == 2


@pytest.mark.parametrize("text", ["", "{", '{"measured": {"a": 1}}', "[1]", "\x00" * 99])
def test_a_damaged_memory_is_none(cache: Path, measurements: list[Candidate], text: str) -> None:
    cache.write_text(text)
    chosen(TrackerConfig(), lambda _: None)
    assert len(measurements) == 3
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

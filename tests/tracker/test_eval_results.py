"""Results as text, a run taken up again, in processes and on a cluster."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.tracker.eval_sets import MovingTracker, StillTracker, sequence_folder, truth, write_boxes
from tracker.eval.benchmark import Results, run_benchmark
from tracker.eval.cluster import ClusterError, run_cluster
from tracker.eval.datasets import Dataset, read_dataset
from tracker.eval.latency import LatencyConfig
from tracker.eval.results import read_results, result_file
from tracker.eval.run import Job, Outcome
from tracker.eval.sequences import Sequence, SequenceError
from tracker.eval.store import Store

SETTINGS = {"weights_sha256": "abc"}


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    for name, count in (("a", 4), ("b", 8), ("c", 6)):
        sequence_folder(tmp_path / "set", name, count)
    return read_dataset(tmp_path / "set")


def run(dataset: Dataset, tracker: type[StillTracker] = MovingTracker, **kw: object) -> tuple[Results, list[str]]:
    said: list[str] = []
    return run_benchmark("ours", Job(tracker), dataset, lambda o: said.append(o.name), **kw), said  # type: ignore[arg-type]


def test_outcomes_are_in_the_data_sets_order_and_right(dataset: Dataset) -> None:
    results, said = run(dataset)
    assert said == ["a", "b", "c"]
    assert [o.name for o in results.outcomes] == ["a", "b", "c"]
    assert all(o.score.precision == 1 and o.score.auc == pytest.approx(20 / 21) for o in results.outcomes)


def test_processes_give_what_one_gives_and_a_broken_sequence_stops_none(dataset: Dataset) -> None:
    (dataset.sequences[1].frames / "0003.png").write_bytes(b"not a picture")
    serial, _ = run(dataset)
    parallel, _ = run(dataset, jobs=2)
    assert [o.name for o in parallel.outcomes] == ["a", "c"]
    for one, other in zip(serial.outcomes, parallel.outcomes, strict=True):
        np.testing.assert_array_equal(one.boxes_xywh, other.boxes_xywh)
    assert [each.name for each in parallel.broken] == ["b"]
    assert "0003.png: not a picture that can be read" in parallel.broken[0].reason


def test_a_finished_sequence_is_not_run_again(dataset: Dataset, tmp_path: Path) -> None:
    folder = tmp_path / "results"
    first, _ = run(replace(dataset, sequences=dataset.sequences[:2]), store=Store(folder, SETTINGS))

    class Fails(StillTracker):
        def init(self, frame_bgr: object, box: object) -> None:
            raise ValueError("run again")

    results, said = run(dataset, Fails, store=Store(folder, SETTINGS))
    assert said == ["a", "b"]
    assert [each.reason for each in results.broken] == ["c: run again"]
    for one, other in zip(first.outcomes, results.outcomes, strict=True):
        np.testing.assert_allclose(one.boxes_xywh, other.boxes_xywh, atol=1e-3)
        assert other.fps == one.fps


@pytest.mark.parametrize("change", ["weights", "boxes cut off", "ground truth"])
def test_what_has_changed_is_run_again(dataset: Dataset, tmp_path: Path, change: str) -> None:
    folder = tmp_path / "results"
    run(dataset, store=Store(folder, SETTINGS))
    if change == "boxes cut off":
        (folder / "b.txt").write_text("1,2,3,4\n")
    if change == "ground truth":
        write_boxes(dataset.sequences[1].frames / "groundtruth.txt", truth(7))
        (dataset.sequences[1].frames / "0008.png").unlink()
        dataset = read_dataset(dataset.sequences[1].frames.parent)
    settings = {"weights_sha256": "other"} if change == "weights" else SETTINGS
    store = Store(folder, settings)
    left = [s.name for s in dataset.sequences if store.finished(s) is None]
    assert left == (["a", "b", "c"] if change == "weights" else ["b"])


def test_a_break_keeps_what_is_finished(dataset: Dataset, tmp_path: Path) -> None:
    folder = tmp_path / "results"

    def interrupt(outcome: Outcome) -> None:
        if outcome.name == "b":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_benchmark("ours", Job(MovingTracker), dataset, interrupt, store=Store(folder, SETTINGS))
    store = Store(folder, SETTINGS)
    assert [s.name for s in dataset.sequences if store.finished(s) is not None] == ["a", "b"]


def test_a_break_ends_the_processes(dataset: Dataset) -> None:
    def interrupt(outcome: Outcome) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_benchmark("ours", Job(MovingTracker), dataset, interrupt, jobs=2)


def test_results_read_back_by_anyone(dataset: Dataset, tmp_path: Path) -> None:
    run(dataset, store=Store(tmp_path / "results", SETTINGS))
    outcomes, broken = read_results(tmp_path / "results", dataset.sequences)
    assert broken == []
    assert all(o.score.precision == 1 and o.fps > 0 for o in outcomes)
    np.testing.assert_allclose(np.loadtxt(tmp_path / "results" / "b.txt", delimiter=","), truth(8), atol=1e-3)
    assert json.loads((tmp_path / "results" / "results.json").read_text())["settings"] == SETTINGS


def test_got10k_submissions_have_their_own_layout(dataset: Dataset, tmp_path: Path) -> None:
    run(dataset, store=Store(tmp_path / "r", SETTINGS, as_got10k=True))
    assert np.loadtxt(tmp_path / "r" / "b" / "b_001.txt", delimiter=",").shape == (8, 4)
    assert np.loadtxt(tmp_path / "r" / "b" / "b_time.txt").shape == (8,)
    outcomes, _ = read_results(tmp_path / "r", dataset.sequences)
    assert len(outcomes) == 3
    assert outcomes[1].fps > 0


def test_late_boxes_are_kept_too(dataset: Dataset, tmp_path: Path) -> None:
    job = Job(MovingTracker, latency=LatencyConfig(10.0))
    first = run_benchmark("ours", job, dataset, lambda _: None, store=Store(tmp_path / "r", SETTINGS))
    again = Store(tmp_path / "r", SETTINGS).finished(dataset.sequences[1])
    assert again is not None
    assert again.late is not None
    assert first.outcomes[1].late is not None
    assert again.late.score == first.outcomes[1].late.score
    assert again.late.fps == 10


@pytest.mark.parametrize("name", ["Jogging-1.txt", "jogging_1.txt", "otb_Jogging_1.txt", "Jogging.1.txt"])
def test_other_toolkits_names_are_found(tmp_path: Path, name: str) -> None:
    (tmp_path / "Jogging-1_time.txt").write_text("")
    (tmp_path / name).write_text("")
    assert result_file(tmp_path, "Jogging-1") == tmp_path / name


def test_boxes_that_the_benchmark_omits_may_be_there(tmp_path: Path) -> None:
    sequence = Sequence("Tiger1", tmp_path, truth(8)[5:], omitted=5)
    for count in (8, 3):
        write_boxes(tmp_path / "Tiger1.txt", truth(8)[8 - count :])
        (outcome,), _ = read_results(tmp_path, (sequence,))
        assert outcome.score.precision == 1


def test_results_that_do_not_fit_are_one_line_each(dataset: Dataset, tmp_path: Path) -> None:
    folder = tmp_path / "other"
    write_boxes(folder / "a.txt", truth(4))
    write_boxes(folder / "b.txt", truth(5))
    outcomes, broken = read_results(folder, dataset.sequences)
    assert [o.name for o in outcomes] == ["a"]
    assert broken[0].reason == f"{folder / 'b.txt'}: 5 result boxes against 8 rows of ground truth"
    assert broken[1].reason == f"{folder}: no boxes of c"
    with pytest.raises(SequenceError, match="boxes of none of the 3 sequences"):
        read_results(tmp_path, dataset.sequences)


def test_a_damaged_record_is_refused(tmp_path: Path) -> None:
    (tmp_path / "results.json").write_text("[1]")
    with pytest.raises(SequenceError, match="damaged, or not of"):
        Store(tmp_path, SETTINGS)


def test_a_cluster_gives_what_one_process_gives(dataset: Dataset) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    (dataset.sequences[1].frames / "0003.png").write_bytes(b"not a picture")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, protocol="tcp://", dashboard_address=None
    ) as cluster:
        results, _ = run(dataset, cluster=cluster.scheduler_address)
    assert [o.name for o in results.outcomes] == ["a", "c"]
    assert all(o.score.precision == 1 for o in results.outcomes)
    assert "not a picture that can be read" in results.broken[0].reason


def test_no_scheduler_is_one_line(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    monkeypatch.setattr("tracker.eval.cluster.CONNECT_S", 0.3)
    with pytest.raises(ClusterError, match="no Dask scheduler answers"):
        list(run_cluster(Job(MovingTracker), dataset.sequences, "tcp://127.0.0.1:9", lambda _: None))


def test_without_dask_the_extra_is_named(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(ClusterError, match=r"climrt-gcs\[cluster\]"):
        list(run_cluster(Job(MovingTracker), dataset.sequences, "tcp://127.0.0.1:9", lambda _: None))

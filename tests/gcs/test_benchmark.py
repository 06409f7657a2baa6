"""`gcs bench`: what it measures comes in the shape it says, and what cannot be measured is one line."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from gcs.benchmark import contrib, growth, machine, reference, roofline, run, timing, trackers
from gcs.benchmark.age import Ages, Spread
from gcs.benchmark.films import BOX, Film, frame, resized, sample
from gcs.benchmark.plot import plot
from gcs.benchmark.report import markdown
from gcs.benchmark.results import Group, Machine, Results
from gcs.benchmark.timing import BenchError, Figure, Sample
from gcs.cli import entry as cli
from gcs.errors import EXIT_USAGE

TINY = run.Counts(rounds=1, film=3, threads=(1,), age_s=0.0, quick=True)


@pytest.fixture(autouse=True)
def threads() -> Iterator[None]:
    """As they were."""
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


class Fixed:
    """A case with known times."""

    threads, uneven = 1, False

    def __init__(self, name: str, *cpu_ms: float, uneven: bool = False) -> None:
        self.name, self.uneven = name, uneven
        self._samples = [Sample(ms, 2 * ms) for ms in cpu_ms]

    def turn(self) -> list[Sample]:
        if not self._samples:
            raise BenchError("it has no times")
        return self._samples


def figure(name: str, *cpu_ms: float, uneven: bool = False) -> Figure:
    case = Fixed(name, *cpu_ms, uneven=uneven)
    return Figure.of(case, case.turn())


def test_cases_take_turns_and_what_fails_is_left_out() -> None:
    order: list[str] = []
    notes: list[str] = []
    a, b, bad = Fixed("a", 1.0, 3.0), Fixed("b", 2.0), Fixed("bad")
    found = timing.in_turns([a, bad, b], 3, order.append, notes.append)
    assert order == ["a", "bad", "b", "a", "b", "a", "b"]
    assert notes == ["bad: it has no times"]
    assert [(f.name, f.samples) for f in found.values()] == [("a", 6), ("b", 3)]
    assert found[a].cpu_ms == 2.0
    assert found[a].wall_p90_ms == 6.0


def test_what_is_uneven_costs_its_mean() -> None:
    times = (1.0, 1.0, 1.0, 9.0)
    assert figure("even", *times).cost_ms == 1.0
    assert figure("uneven", *times, uneven=True).cost_ms == 3.0
    one = figure("one", 4.0)
    assert timing.ratios([figure("half", 2.0), one], one) == {"half": 0.5}


def test_a_short_call_is_repeated_within_a_sample() -> None:
    calls = [0]

    def call() -> None:
        calls[0] += 1

    case = timing.Repeated("short", call, samples=2)
    assert len(case.turn()) == 2
    assert calls[0] > 100


def test_the_film_is_the_sample_at_any_size() -> None:
    film = sample(3)
    assert len(film.frames) == 3
    large = resized(film, 1280, 720)
    assert large.size == (1280, 720)
    assert large.box.cx_px / 1280 == pytest.approx(film.box.cx_px / film.size[0])


def test_a_tracker_goes_round_and_its_first_picture_is_not_timed() -> None:
    class Counting:
        inits = updates = 0

        def init(self, frame_bgr: object, box: object) -> None:
            self.inits += 1

        def update(self, frame_bgr: object) -> None:
            self.updates += 1

    tracker = Counting()
    film = Film("f", tuple(frame(i, (80, 120)) for i in range(4)), BOX)
    case = trackers.OnFilm("counting", film, lambda: tracker, frames=6, warm=0, most_turns=1)
    assert len(case.turn()) == 6
    assert (tracker.inits, tracker.updates) == (2, 6)  # three pictures after each first one
    assert case.turn() == []


def test_files_that_are_not_there_are_one_line_each(tmp_path: Path) -> None:
    notes: list[str] = []
    nothing = tmp_path / "none.onnx"
    cases = list(trackers.of_opencv(sample(3), 1, (nothing, nothing), nothing, notes.append))
    assert [case.name for case in cases] == ["OpenCV MIL"]
    assert notes == [
        f"OpenCV Nano: no such file: {nothing}, {nothing}",
        f"OpenCV Vit: no such file: {nothing}",
    ]


def test_a_file_that_is_no_network_is_one_line(tmp_path: Path) -> None:
    wrong, notes = tmp_path / "wrong.onnx", []
    wrong.write_bytes(b"no network")
    *_, vit = trackers.of_opencv(sample(3), 1, None, wrong, notes.append)
    assert timing.in_turns([vit], 1, str, notes.append) == {}
    assert len(notes) == 1
    assert notes[0].startswith("OpenCV Vit: ")
    assert "\n" not in notes[0]


def test_without_a_network_the_contributed_trackers_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(contrib, "version", lambda package: "0.0.0")  # there is none of it
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    with pytest.raises(BenchError, match=r"opencv-contrib-python-headless==0\.0\.0 cannot be installed: ") as refused:
        contrib.environment(tmp_path, str)
    assert "\n" not in str(refused.value)


def test_the_worker_answers_with_times(tmp_path: Path) -> None:
    """By this interpreter: our own OpenCV has MIL, and no CSRT."""
    import sys

    worker = contrib.Worker(Path(sys.executable), sample(3), tmp_path)
    try:
        answer = worker.ask(tracker="MIL", threads=1, frames=2, warm=1)
        assert len(answer["cpu_ms"]) == len(answer["wall_ms"]) == 2
        with pytest.raises(BenchError, match="TrackerCSRT"):
            worker.ask(tracker="CSRT", threads=1, frames=1, warm=0)
    finally:
        worker.close()


def test_what_binds_a_stage() -> None:
    assert roofline.bound_by(10.0, compute_ms=8.0, memory_ms=1.0) == "multiply-adds"
    assert roofline.bound_by(10.0, compute_ms=1.0, memory_ms=6.0) == "memory"
    assert roofline.bound_by(10.0, compute_ms=1.0, memory_ms=2.0) == "overhead"


def test_bytes_are_those_that_operations_read_and_write() -> None:
    a, b = torch.zeros(100), torch.zeros(100)
    assert roofline.moved_mb(lambda: a + b) == pytest.approx(3 * 400 / 1e6)
    assert roofline.moved_mb(lambda: a.view(10, 10)) == 0


def test_the_peak_is_the_fastest_at_so_many_threads() -> None:
    found = {"sgemm by torch, 1 thread": 90.0, "convolution, 1 thread": 200.0, "sgemm by torch, 2 threads": 150.0}
    found |= {"sgemm by numpy, its own threads": 80.0, "memory copy, 1 thread": 300.0}
    assert machine.peak_gflops(found) == 200.0
    assert machine.peak_gflops(found, 2) == 150.0
    assert machine.bandwidth_gbps(found) == 300.0
    assert str(machine.describe()["cpu"]).partition(" ")[2].startswith("vCPU")


def test_what_moved_against_the_reference(tmp_path: Path) -> None:
    file = tmp_path / "reference.json"
    assert reference.load(file) is None
    facts = {"cpu": "2 vCPU"}
    reference.update(facts, {"a": {"same": 1.0, "slower": 1.0, "tiny": 0.001}, "b": {"kept": 2.0}}, file)
    reference.update(facts, {"a": {"same": 1.0, "slower": 1.0, "tiny": 0.001}}, file)
    known = reference.load(file)
    assert known is not None
    assert known.ratios["b"] == {"kept": 2.0}
    found = reference.changes({"a": {"same": 1.29, "slower": 1.4, "tiny": 0.003, "new": 1.0}}, known)
    assert [(change.name, change.moved) for change in found] == [("same", False), ("slower", True), ("tiny", False)]
    assert str(found[1]) == "slower: 1.4 now, 1 then (+40%)"
    file.write_text('{"machine": 1}')
    with pytest.raises(BenchError, match=r"reference\.json"):
        reference.load(file)


def test_the_committed_reference_can_be_read() -> None:
    known = reference.load()
    assert known is not None
    assert any(title.startswith("trackers, ") for title in known.ratios)
    assert all(np.isfinite(value) for rows in known.ratios.values() for value in rows.values())


def test_everything_found_is_told_and_drawn(tmp_path: Path) -> None:
    first, other = figure("compact, torch", 10.0), figure("OpenCV KCF", 2.0)
    spread = Spread(40.0, 60.0, 70.0)
    ages = Ages("640x480", "compact", spread, spread, {"track": spread}, 400, 29.5, 1.0, 0.6)
    results = Results(
        machine=Machine({"cpu": "2 vCPU"}, {"sgemm by torch, 1 thread": 90.0}, {1: 90.0}, 30.0, (0.1, 0.2)),
        trackers=[Group("trackers, 480x360, 1 thread", [first, other], first)],
        stages=[Group("stages", [other], first)],
        roofline=[roofline.Point("embed", 0.6, 15.0, 6.0, 200.0, 0.9, "multiply-adds")],
        ages=[ages],
        growth=[growth.Size("480p", (854, 480), {"H.264 decode": 1.0, "track": 15.0})],
        memory_mib={"tracker": 400.0},
        notes=["OpenCV Nano: no such file: x"],
        changes=[reference.Change("stages", "HUD", 0.2, 0.1)],
        seconds={"trackers": 3.0},
    )
    text = markdown(results)
    assert "| compact, torch |" in text
    assert "0.20 |" in text  # KCF's ratio
    assert "NanoTrack v3: 107 pictures a second" in text
    assert "HUD: 0.2 now, 0.1 then (+100%)" in text
    assert "- OpenCV Nano: no such file: x" in text
    said = json.loads(json.dumps(results.as_json()))
    assert said["format"] == "gcs-bench/1"
    assert said["groups"][0]["ratios"] == {"OpenCV KCF": 0.2}
    assert said["ages"][0]["setpoint"] == {"p50": 40.0, "p99": 60.0, "most": 70.0}
    assert said["growth"][0]["total_ms"] == 16.0
    plot(tmp_path / "plot.png", results)
    assert (tmp_path / "plot.png").stat().st_size > 10_000
    plot(tmp_path / "none.png", Results())
    assert not (tmp_path / "none.png").exists()


def test_trackers_on_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gcs.benchmark.command.QUICK", TINY)
    monkeypatch.setattr(trackers, "available_engines", lambda: ["torch"])
    argv = ["bench", "--quick", "--json", "--no-contrib", "--out", str(tmp_path / "out"), "--vit", "none.onnx"]
    assert cli.main([*argv, "--only", "trackers", "growth"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert [group["title"] for group in said["groups"]] == ["trackers, 480x360, 1 thread", "size of the picture"]
    names = [one["name"] for one in said["groups"][0]["figures"]]
    assert names == ["compact, torch", "compact with ClimNet, torch", "OpenCV MIL"]
    assert said["notes"] == ["OpenCV Vit: no such file: none.onnx"]
    assert json.loads((tmp_path / "out" / "bench.json").read_text()) == said
    assert {file.name for file in (tmp_path / "out").iterdir()} == {"table.md", "bench.json", "plot.png"}


def test_a_rough_run_becomes_no_reference(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    argv = ["bench", "--quick", "--update-reference", "--out", str(tmp_path)]
    assert cli.main(argv) == EXIT_USAGE
    assert capsys.readouterr().err == "gcs: --update-reference with --quick: a reference is worth its minutes\n"

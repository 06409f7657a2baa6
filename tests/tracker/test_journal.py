"""The log stays readable however a run is resumed; the picture is drawn from it."""

import csv
import logging
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from tracker.train import journal as journal_module
from tracker.train.curves import PANELS, draw_curves, lines_of, smoothed
from tracker.train.journal import Journal, read_log


def test_a_figure_that_appears_later_adds_a_column_and_moves_none(tmp_path: Path) -> None:
    journal = Journal(tmp_path, tensorboard=False)
    journal.log(32, "backbone", {"siamese": 0.5, "lr": 1e-3})
    first = (tmp_path / "log.csv").read_text().splitlines()[0].split(",")
    journal.log(64, "joint", {"lr": 1e-3, "loc": 0.25})
    rows = list(csv.reader((tmp_path / "log.csv").open(newline="")))
    assert rows[0][: len(first)] == first
    assert {len(row) for row in rows} == {len(first) + 1}
    assert [row.get("loc") for row in read_log(tmp_path / "log.csv")] == [None, 0.25]
    assert [row.get("siamese") for row in read_log(tmp_path / "log.csv")] == [0.5, None]


def test_a_resumed_run_goes_on_in_the_same_log(tmp_path: Path) -> None:
    for samples in (32, 64, 96):
        journal = Journal(tmp_path, tensorboard=False)
        journal.log(samples, "joint", {"loc": 1 / samples})
        journal.close()
    rows = read_log(tmp_path / "log.csv")
    assert [row["samples"] for row in rows] == [32, 64, 96]
    assert rows[2]["loc"] == pytest.approx(1 / 96, rel=1e-5)
    assert (tmp_path / "log.csv").read_text().count("samples") == 1  # one header


def test_a_torn_last_line_costs_that_line_only(tmp_path: Path) -> None:
    journal = Journal(tmp_path, tensorboard=False)
    journal.log(32, "joint", {"loc": 1.0})
    with (tmp_path / "log.csv").open("a") as file:
        file.write("17000")  # the power went here
    Journal(tmp_path, tensorboard=False).log(64, "joint", {"loc": 0.5, "cls1": 0.1})
    rows = read_log(tmp_path / "log.csv")
    assert [row["samples"] for row in rows if "samples" in row] == [32, 64]
    assert Journal(tmp_path, tensorboard=False).draw().exists()


def test_infinite_and_missing_losses_are_logged_and_drawn(tmp_path: Path) -> None:
    journal = Journal(tmp_path, tensorboard=False)
    for i in range(30):
        journal.log(i, "joint", {"loc": float("nan") if i == 5 else float("inf") if i == 6 else 1.0})
    assert cv2.imread(str(journal.draw())) is not None


def test_events_reach_tensorboard(tmp_path: Path) -> None:
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    journal = Journal(tmp_path)
    journal.log(32, "joint", {"loc": 0.75})
    journal.close()
    events = accumulator.EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    (scalar,) = events.Scalars("joint/loc")
    assert (scalar.step, scalar.value) == (32, 0.75)


def test_without_tensorboard_it_is_said_once_and_the_log_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    journal_module._say_once.cache_clear()
    with caplog.at_level(logging.WARNING):
        for _ in range(2):
            journal = Journal(tmp_path)
            journal.log(32, "joint", {"loc": 0.75})
            journal.close()
    assert len(caplog.records) == 1
    assert "climrt-gcs[train]" in caplog.text
    assert len(read_log(tmp_path / "log.csv")) == 2


def test_figures_find_their_panels(tmp_path: Path) -> None:
    journal = Journal(tmp_path, tensorboard=False)
    journal.log(10, "joint", {"loc": 1.0, "lr": 0.1, "samples_per_s": 9.0})
    journal.log(10, "validation", {"hit_rate": 0.5, "psnr_db": 30.0})
    journal.log(20, "climnet", {"l1": 1.0, "psnr_db": 25.0})
    rows = read_log(tmp_path / "log.csv")
    shown = [sorted(lines_of(rows, panel)) for panel in PANELS]
    assert shown == [["l1", "loc"], ["hit_rate"], ["psnr_db", "psnr_db (held out)"], ["lr"], ["samples_per_s"]]


def test_a_log_without_figures_still_gives_a_picture(tmp_path: Path) -> None:
    assert cv2.imread(str(draw_curves([], tmp_path / "empty.png"))) is not None


def test_smoothing_keeps_a_mean_and_a_constant() -> None:
    noise = np.random.default_rng(0).normal(5, 1, 1000)
    assert np.abs(smoothed(noise) - 5).max() < 1
    assert smoothed(np.full(50, 2.0)) == pytest.approx(2.0)

"""What a training run says of itself: log.csv, TensorBoard's events, and a picture of the curves."""

from __future__ import annotations

import csv
import logging
import time
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from tracker.train.curves import draw_curves

LOG_NAME, CURVES_NAME, EVENTS_NAME = "log.csv", "curves.png", "tensorboard"
FIRST_COLUMNS = ("time", "stage", "samples")


class Journal:
    """One run's journal in its folder; opening it again goes on with the same log.

    log.csv has one row per entry and one column per figure; a figure that first appears later adds a column
    at the right end, so the columns before it stay where they were.
    """

    def __init__(self, folder: Path, tensorboard: bool = True) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._path, self._picture = folder / LOG_NAME, folder / CURVES_NAME
        self._columns = _mended_columns(self._path)
        self._writer = _event_writer(folder / EVENTS_NAME) if tensorboard else None

    def log(self, samples: int, stage: str, figures: Mapping[str, float]) -> None:
        """Note the figures of a moment: `samples` trained on so far, and the stage they belong to."""
        row = {"time": f"{time.time():.1f}", "stage": stage, "samples": samples}
        row |= {name: f"{value:.6g}" for name, value in figures.items()}
        if new := [name for name in row if name not in self._columns]:
            self._columns += new
            _rewrite(self._path, self._columns)
        with self._path.open("a", newline="", encoding="utf-8") as file:
            csv.DictWriter(file, self._columns).writerow(row)
        if self._writer is not None:
            for name, value in figures.items():
                self._writer.add_scalar(f"{stage}/{name}", value, samples)

    def draw(self) -> Path:
        """Write curves.png from log.csv, so that it shows the whole run however often it was resumed."""
        rows = read_log(self._path) if self._path.exists() else []
        return draw_curves(rows, self._picture)

    def close(self) -> None:
        """Finish TensorBoard's file; log.csv needs nothing."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None


def read_log(path: Path) -> list[dict[str, Any]]:
    """Rows of a log.csv: stage as text, everything else as float, empty cells left out."""
    with path.open(newline="", encoding="utf-8") as file:
        return [_typed(row) for row in csv.DictReader(file)]


def _typed(row: dict[str | None, Any]) -> dict[str, Any]:
    typed: dict[str, Any] = {}
    for name, cell in row.items():
        if name == "stage":
            typed[name] = cell or ""
        elif name is not None and cell:
            try:
                typed[name] = float(cell)
            except ValueError:  # a line torn by a power cut: the rest of it is still good
                continue
    return typed


def _mended_columns(path: Path) -> list[str]:
    """The columns of the log that is there (none: the first ones, written); a torn last line is ended."""
    if not path.exists() or not path.stat().st_size:
        _rewrite(path, list(FIRST_COLUMNS))
        return list(FIRST_COLUMNS)
    text = path.read_text(encoding="utf-8")
    if not text.endswith("\n"):
        path.write_text(text + "\n", encoding="utf-8")
    with path.open(newline="", encoding="utf-8") as file:
        return next(csv.reader(file))


def _rewrite(path: Path, columns: list[str]) -> None:
    """The same rows under a wider header, written whole or not at all."""
    rows: list[dict[str | None, Any]] = []
    if path.exists():
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    temporary = path.with_name(path.name + ".part")
    with temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    temporary.replace(path)


@cache
def _say_once() -> None:
    logging.getLogger(__name__).warning(
        "no TensorBoard events, log.csv and curves.png only: pip install 'climrt-gcs[train]' brings TensorBoard"
    )


def _event_writer(folder: Path) -> Any:
    """TensorBoard's writer, or None where TensorBoard is not installed."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        _say_once()
        return None
    return SummaryWriter(str(folder))

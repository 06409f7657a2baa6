"""A folder of results: boxes as text for any toolkit, and a record by which an interrupted run is taken up again."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from tracker.eval.latency import LateOutcome
from tracker.eval.ope import score
from tracker.eval.results import read_result
from tracker.eval.run import Outcome
from tracker.eval.sequences import Sequence, SequenceError, read_boxes

RECORD = "results.json"


class Store:
    """Writes each outcome as it is finished; finds those of an earlier run with the same settings."""

    def __init__(self, folder: Path, settings: dict[str, Any], *, as_got10k: bool = False) -> None:
        """settings: weights' sha256, configuration and whatever else the boxes depend on (JSON values).

        as_got10k: boxes in the layout of GOT-10k's submissions. Raises SequenceError for a damaged record.
        """
        self.folder = folder
        self.is_taken_up = False
        self._as_got10k = as_got10k
        self._settings = json.loads(json.dumps(settings))
        self._records: dict[str, dict[str, Any]] = {}
        try:
            found = json.loads((folder / RECORD).read_text(encoding="utf-8"))
            if found["settings"] == self._settings:
                self._records = dict(found["sequences"])
                self.is_taken_up = True
        except FileNotFoundError:
            pass
        except (ValueError, KeyError, TypeError):
            raise SequenceError(
                f"{folder / RECORD}: damaged, or not of `gcs bench track`; name another folder"
            ) from None

    def finished(self, sequence: Sequence) -> Outcome | None:
        """The outcome of an earlier run, scored against the ground truth as it is now; None: it is to be run."""
        record, path = self._records.get(sequence.name), self._path(sequence.name)
        if record is None or not path.is_file():
            return None
        try:
            outcome = read_result(path, sequence)
            late = self._late(sequence, record)
            return Outcome(outcome.name, outcome.boxes_xywh, outcome.score, float(record["fps"]), outcome.times_s, late)
        except (ValueError, KeyError, TypeError):
            return None  # another edition of the sequence, or a file that was cut off

    def add(self, outcome: Outcome) -> None:
        """Write boxes, times and the record."""
        path = self._path(outcome.name)
        _write_rows(path, outcome.boxes_xywh, "%.3f")
        times = path.with_name(f"{outcome.name}_time.txt")
        _write_rows(times, outcome.times_s, "%.8f")
        record: dict[str, Any] = {"frames": len(outcome.boxes_xywh), "fps": outcome.fps}
        if outcome.late is not None:
            record |= {"skipped": outcome.late.skipped, "clock_fps": outcome.late.fps}
            for late_path, boxes in zip(
                self._late_paths(outcome.name), (outcome.late.boxes_xywh, outcome.late.predicted_xywh), strict=True
            ):
                _write_rows(late_path, boxes, "%.3f")
        self._records[outcome.name] = record
        text = json.dumps({"settings": self._settings, "sequences": self._records}, indent=1)
        temporary = self.folder / f"{RECORD}.part"
        temporary.write_text(text + "\n", encoding="utf-8")
        os.replace(temporary, self.folder / RECORD)

    def _path(self, name: str) -> Path:
        return self.folder / name / f"{name}_001.txt" if self._as_got10k else self.folder / f"{name}.txt"

    def _late_paths(self, name: str) -> tuple[Path, Path]:
        return self.folder / "late" / f"{name}.txt", self.folder / "late_predicted" / f"{name}.txt"

    def _late(self, sequence: Sequence, record: dict[str, Any]) -> LateOutcome | None:
        if "skipped" not in record:
            return None
        plain, predicted = (read_boxes(path) for path in self._late_paths(sequence.name))
        truth = sequence.truth_xywh
        scores = score(plain, truth), score(predicted, truth)
        return LateOutcome(plain, predicted, *scores, float(record["skipped"]), float(record["clock_fps"]))


def _write_rows(path: Path, rows: np.ndarray[Any, Any], form: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(path.name + ".part")
    np.savetxt(temporary, rows, fmt=form, delimiter=",")
    os.replace(temporary, path)

"""Per-frame boxes as text, in the forms that other toolkits write."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tracker.eval.datasets import Broken
from tracker.eval.ope import score
from tracker.eval.run import Outcome
from tracker.eval.sequences import Sequence, SequenceError, read_boxes

# Prefixes that toolkits put before a sequence's own name.
PREFIXES = ("uav_", "otb_", "uav123_", "dtb70_")


def result_file(folder: Path, name: str) -> Path | None:
    """A sequence's boxes in a tracker's folder: NAME.txt (UAV123, OTB), or NAME/NAME_001.txt (GOT-10k).

    Case, toolkits' prefixes, and the sign before a part's number (Jogging-1, jogging_1, Jogging.1) do not matter.
    """
    exact = folder / f"{name}.txt", folder / name / f"{name}_001.txt"
    found = next((path for path in exact if path.is_file()), None)
    if found is not None or not folder.is_dir():
        return found
    wanted = _plain(name)
    files = (path for path in sorted(folder.glob("*.txt")) if not path.stem.endswith("_time"))
    return next((path for path in files if _plain(path.stem) == wanted), None)


def read_results(folder: Path, sequences: tuple[Sequence, ...]) -> tuple[list[Outcome], list[Broken]]:
    """Another tracker's results, scored; sequences that it has no boxes for, or that do not fit, apart.

    Raises SequenceError where the folder is none, or holds nothing for any of the sequences.
    """
    if not folder.is_dir():
        raise SequenceError(f"{folder}: no such folder of results")
    outcomes, broken = [], []
    for sequence in sequences:
        path = result_file(folder, sequence.name)
        if path is None:
            broken.append(Broken(sequence.name, f"{folder}: no boxes of {sequence.name}"))
            continue
        try:
            outcomes.append(read_result(path, sequence))
        except ValueError as error:
            text = str(error)
            broken.append(Broken(sequence.name, text if str(path) in text else f"{path}: {text}"))
    if not outcomes:
        why = broken[0].reason if len(broken) == 1 else f"{folder}: boxes of none of the {len(broken)} sequences"
        raise SequenceError(why)
    return outcomes, broken


def read_result(path: Path, sequence: Sequence) -> Outcome:
    """One file of boxes, scored; frames a second are NaN where no times lie beside it. Raises ValueErrors."""
    boxes = read_boxes(path)
    if sequence.omitted and len(boxes) == len(sequence) + sequence.omitted:
        boxes = boxes[sequence.omitted :]
    times_s = _read_times(path)
    spent_s = float(times_s[1:].sum())
    fps = (len(times_s) - 1) / spent_s if spent_s > 0 else float("nan")
    return Outcome(sequence.name, boxes, score(boxes, sequence.truth_xywh), fps, times_s)


def _read_times(path: Path) -> NDArray[np.float64]:
    """Seconds per frame beside a file of boxes; empty where there are none, or something else."""
    file = path.with_name(re.sub(r"_001$", "", path.stem) + "_time.txt")
    try:
        return np.array([float(v) for v in file.read_text().split()])
    except (OSError, ValueError):
        return np.zeros(0)


def _plain(name: str) -> str:
    plain = re.sub(r"[-.]", "_", name.lower())
    return next((plain.removeprefix(p) for p in PREFIXES if plain.startswith(p)), plain)

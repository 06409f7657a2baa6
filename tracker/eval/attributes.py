"""The difficulties that benchmarks mark their sequences with, and scores of the sequences that have each."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from tracker.eval.sequences import Sequence, SequenceError

# In the order of each benchmark's own files (0 or 1 per attribute).
UAV123_ORDER = ("SV", "ARC", "LR", "FM", "FOC", "POC", "OV", "BC", "IV", "VC", "CM", "SOB")
UAVTRACK112_ORDER = ("FM", "LR", "LTT", "ARC", "SV", "POC", "FOC", "CM", "OV", "IV", "LI", "VC", "SOB")
OTB_ORDER = ("IV", "OPR", "SV", "OCC", "DEF", "MB", "FM", "IPR", "OV", "BC", "LR")

NAMES = {
    "ARC": "aspect ratio change",
    "BC": "background clutter",
    "CM": "camera motion",
    "DEF": "deformation",
    "FM": "fast motion",
    "FOC": "full occlusion",
    "IPR": "in-plane rotation",
    "IV": "illumination variation",
    "LI": "low illumination",
    "LR": "low resolution",
    "LTT": "long-term tracking",
    "MB": "motion blur",
    "OCC": "occlusion",
    "OPR": "out-of-plane rotation",
    "OV": "out of view",
    "POC": "partial occlusion",
    "SOB": "similar object",
    "SV": "scale variation",
    "VC": "viewpoint change",
}


def read_attributes(folders: Iterable[Path], name: str, order: tuple[str, ...]) -> tuple[str, ...] | None:
    """The attributes of a sequence from the first folder that has NAME.txt; None where none has.

    Raises SequenceError where the file has another number of marks than the benchmark's order.
    """
    file = next((folder / f"{name}.txt" for folder in folders if (folder / f"{name}.txt").is_file()), None)
    if file is None:
        return None
    marks = [mark for mark in re.split(r"[,;\s]+", file.read_text().strip()) if mark]
    if len(marks) != len(order) or not set(marks) <= {"0", "1"}:
        raise SequenceError(f"{file}: not {len(order)} marks of 0 or 1")
    return tuple(short for short, mark in zip(order, marks, strict=True) if mark == "1")


def by_attribute(sequences: Iterable[Sequence]) -> dict[str, tuple[str, ...]]:
    """Names of the sequences that have each attribute, in alphabetical order; empty where nothing is marked."""
    found: dict[str, list[str]] = {}
    for sequence in sequences:
        for short in sequence.attributes or ():
            found.setdefault(short, []).append(sequence.name)
    return {short: tuple(found[short]) for short in sorted(found)}

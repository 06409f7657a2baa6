"""One damaged weights file after the other through the real loader; for `tests.fuzz.worker`."""

from __future__ import annotations

import hashlib
import json
import math
import random
from pathlib import Path
from typing import Any

import torch

from gcs.errors import one_line
from tests.fuzz.process import Case, bad_line
from tests.fuzz.videos import damage
from tests.tracker.conftest import random_network
from tracker.weights import WeightsError, load_tracker, save


class WeightsCases:
    """A tiny network's file, and its manifest, which half of the time vouches for the damage."""

    def __init__(self, folder: Path) -> None:
        torch.set_num_threads(1)
        self._path = folder / "w.safetensors"
        self._manifest = self._path.with_suffix(".json")
        save(self._path, random_network())
        self._data = self._path.read_bytes()
        self._values: dict[str, Any] = json.loads(self._manifest.read_text())

    def run(self, rng: random.Random) -> Case:
        """Damage the tensors, the manifest's values or its text, then load."""
        kind = rng.choice(("tensors", "tensors, vouched for", "header, vouched for", "manifest", "manifest's text"))
        data, values, text = self._data, json.loads(json.dumps(self._values)), ""
        if kind.startswith("tensors"):
            data = damage(rng, data)
        elif kind.startswith("header"):
            data = _damage_header(rng, data)
        elif kind == "manifest":
            _damage_value(rng, values)
        if kind.endswith("vouched for"):
            values["sha256"] = hashlib.sha256(data).hexdigest()
        text = json.dumps(values)
        self._path.write_bytes(data)
        self._manifest.write_bytes(damage(rng, text.encode()) if kind == "manifest's text" else text.encode())
        return _load(self._path, kind)

    def close(self) -> None:
        """Nothing is open."""


def _load(path: Path, kind: str) -> Case:
    try:
        load_tracker(path)
    except WeightsError as error:
        # The command line makes one line of it; it must name the file, and be no page.
        return Case(kind, False, one_line(error), bad_line(one_line(error)) or _unnamed(path, str(error)))
    except BaseException as error:  # noqa: BLE001 - this is what is looked for
        return Case(kind, False, "", f"{type(error).__name__} leaves load_tracker: {one_line(error)}")
    return Case(kind, True, "", "")


def _unnamed(path: Path, text: str) -> str:
    return "" if path.stem in text else f"does not name the file: {text[:200]!r}"


def _damage_header(rng: random.Random, data: bytes) -> bytes:
    length = int.from_bytes(data[:8], "little")
    header = damage(rng, data[8 : 8 + length])
    claimed = rng.choice((len(header), len(header), 0, 1 << 40, (1 << 64) - 1))
    return claimed.to_bytes(8, "little") + header + data[8 + length :]


def _damage_value(rng: random.Random, values: Any) -> None:
    """Put something absurd in place of a value somewhere in the tree, or take one out."""
    while True:
        key = rng.choice(list(values) if isinstance(values, dict) else list(range(len(values))))
        if isinstance(values[key], dict | list) and values[key] and rng.random() < 0.8:
            values = values[key]
            continue
        if isinstance(values, dict) and rng.random() < 0.2:
            del values[key]
        else:
            values[key] = rng.choice(_ABSURD)
        return


_ABSURD: tuple[Any, ...] = (
    None, True, 0, -1, 1.5, 1 << 40, 10**30, math.nan, math.inf, "", "x" * 1000, "\x1b[2J\n", [], [1] * 5, {}, {"a": 1},
    65536, 4096, 1e-300, [[]], "climnet",
)  # fmt: skip

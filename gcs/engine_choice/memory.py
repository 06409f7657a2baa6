"""What was measured on this machine with these versions, in a file of the user's cache."""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import os
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Final

import msgspec

from gcs.engine_choice.measure import Measured
from gcs.recorder.facts import machine
from gcs.result_file import result_file

_KEPT: Final = 8  # machines (a home folder may be shared) and versions of the program
_MOST_BYTES: Final = 1_000_000
_PACKAGES: Final = ("climrt-gcs", "torch", "openvino", "onnxruntime", "onnx", "opencv-python-headless", "numpy")
_PASSING: Final = ("memory_mb", "platform")  # of a container, of a kernel's update
log = logging.getLogger(__name__)


class _File(msgspec.Struct):
    """measured: by the digest of the machine and of what ran on it, the newest last."""

    measured: dict[str, list[Measured]]


def remembered() -> list[Measured]:
    """What is known; nothing where the file is missing or unreadable, for it can be measured again."""
    return [each for each in _read().measured.get(_key(), []) if each.update_ms > 0 and each.cpu_ms > 0]


def remember(measured: Sequence[Measured]) -> None:
    """Keep it for the next start; where that cannot be written it is said, and measured again then."""
    known, key = _read().measured, _key()
    known.pop(key, None)
    known[key] = list(measured)
    try:
        path = _path()
        path.parent.mkdir(parents=True, exist_ok=True)
        with result_file(path) as file:
            file.write(msgspec.json.encode(_File(dict(list(known.items())[-_KEPT:]))))
    except OSError as error:
        where = error.filename or "cache"
        log.warning("what was measured of the tracker is not remembered: %s: %s", where, error.strerror or error)


def _read() -> _File:
    try:
        with _path().open("rb") as file:
            return msgspec.json.decode(file.read(_MOST_BYTES), type=_File)
    except (OSError, ValueError):
        return _File({})


def _path() -> Path:
    """CLIMRT_CACHE, or the system's place for what may be lost. OSError where there is none."""
    if own := os.environ.get("CLIMRT_CACHE"):
        return Path(own) / "engines.json"
    cache = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    try:
        return (Path(cache) if cache else Path.home() / ".cache") / "climrt-gcs" / "engines.json"
    except RuntimeError as error:  # a user of a container that has no home
        raise OSError(str(error)) from error


def _key() -> str:
    facts = {name: value for name, value in machine().items() if name not in _PASSING}
    with contextlib.suppress(OSError):  # a GPU that is new here
        facts["gpu_driver"] = Path("/proc/driver/nvidia/version").read_text(encoding="utf-8", errors="replace")
    for name in _PACKAGES:
        try:
            facts[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            facts[name] = ""
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:16]

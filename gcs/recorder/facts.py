"""Gathers what a flight is flown with. Imports no PyTorch: what it tells is asked once it is there."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import os
import platform
import sys
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Final

from gcs.clock import Clock
from gcs.config import Config
from gcs.recorder.manifest import Manifest, VideoFacts, WeightsFacts, plain
from gcs.tracking import BoxTracker
from gcs.video import VideoSource
from gcs.video.frame import redact

_PACKAGES: Final = (
    "climrt-gcs", "numpy", "scipy", "torch", "opencv-python-headless", "av", "mavsdk", "pymavlink", "filterpy",
    "msgspec", "safetensors", "xxhash", "openvino", "onnxruntime",
)  # fmt: skip
# What changes the last bits of a result.
_FLAGS: Final = (
    "sse4_2",
    "avx",
    "f16c",
    "fma",
    "avx2",
    "avx512f",
    "avx512bw",
    "avx512vl",
    "avx512_vnni",
    "asimd",
    "sve",
)
NUMBER_VARIABLES: Final = (
    "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENBLAS_CORETYPE", "ATEN_CPU_CAPABILITY",
    "NPY_DISABLE_CPU_FEATURES", "OPENCV_CPU_DISABLE", "MKL_CBWR",
)  # fmt: skip


def gather(
    kind: str,
    config: Config,
    clock: Clock,
    *,
    source: VideoSource | None = None,
    vehicle: str | None = None,
    seed: int | None = None,
    watermark: str | None = None,
) -> Manifest:
    """For `write_manifest`, at the start. Some 50 ms of looking at files: not for the event loop."""
    t_s, unix_s = origin(clock)
    video = None
    if source is not None:
        video = VideoFacts(redact(source.name), *source.size, source.fps)
    return Manifest(
        kind=kind, started=utc(unix_s), t_start_s=t_s, unix_start_s=unix_s, software=software(), machine=machine(),
        config=plain(config), video=video, vehicle=None if vehicle is None else redact(vehicle), seed=seed,
        watermark=watermark,
    )  # fmt: skip


def origin(clock: Clock) -> tuple[float, float]:
    """The flight's clock and seconds since 1970, of one moment."""
    readings = []
    for _ in range(5):  # the one least interrupted
        before_s, unix_s, after_s = clock.now_s(), time.time(), clock.now_s()
        readings.append((after_s - before_s, (before_s + after_s) / 2, unix_s))
    _, t_s, unix_s = min(readings)
    return t_s, unix_s


def utc(unix_s: float) -> str:
    """ISO 8601."""
    return datetime.fromtimestamp(unix_s, UTC).isoformat(timespec="seconds")


def software() -> dict[str, str]:
    """Versions by name; code: the SHA-256 of our own source files."""
    found = {"python": platform.python_version(), "code": _code_sha256()}
    for name in _PACKAGES:
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found


def _code_sha256() -> str:
    digest = hashlib.sha256()
    for package in ("control", "gcs", "tracker"):
        folder = Path(importlib.import_module(package).__path__[0])
        for path in sorted(folder.rglob("*.py")):
            digest.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def machine() -> dict[str, str]:
    """What the last bits of a result may depend on."""
    cpu = dict(_cpu())
    found = {
        "platform": platform.platform(),
        "architecture": platform.machine(),
        "cpu": cpu.get("model name", platform.processor() or platform.machine()),
        "cpu_flags": " ".join(flag for flag in _FLAGS if flag in cpu.get("flags", cpu.get("Features", "")).split()),
        "cores": str(usable_cores()),
    }
    with contextlib.suppress(ValueError, OSError, AttributeError):
        found["memory_mb"] = str(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 1_000_000)
    return found | {name: os.environ[name] for name in NUMBER_VARIABLES if name in os.environ}


def usable_cores() -> int:
    """CPUs that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _cpu() -> Iterator[tuple[str, str]]:
    """Of the first processor, where the system tells."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text().split("\n\n", 1)[0].splitlines():
            name, _, value = line.partition(":")
            yield name.strip(), value.strip()


def weights_of(tracker: BoxTracker) -> WeightsFacts | None:
    """Of a tracker that has been loaded; None for one without weights."""
    online = sys.modules.get("tracker.online")
    if online is None or not isinstance(tracker, online.ClimRTTracker) or tracker.loaded is None:
        return None
    loaded = tracker.loaded
    return WeightsFacts(loaded.weights, loaded.sha256, loaded.threads, loaded.engine, tracker.config.latent.value)


def pytorch_facts() -> dict[str, str]:
    """Which of its code PyTorch has chosen for this processor, once it is there; for `Manifest.machine`."""
    torch = sys.modules.get("torch")
    return {} if torch is None else {"torch_cpu": str(torch.backends.cpu.get_cpu_capability())}

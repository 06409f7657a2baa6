"""What this machine can do at best: multiply-adds and memory, measured beside everything else."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

import numpy as np
import torch
from torch.nn import functional

from gcs.benchmark.timing import Case, Figure, Repeated

_SIDE: Final = 1536
_CONVOLUTIONS: Final = ((256, 3, 28), (256, 3, 56), (512, 1, 56))  # channels, kernel, side: such as oneDNN likes best
_COPY_MB: Final = 256  # more than any cache
_PACKAGES: Final = ("torch", "numpy", "opencv-python-headless", "openvino", "onnxruntime", "av")


def cases(thread_counts: Sequence[int]) -> Iterator[tuple[Case, float]]:
    """Each with the GFLOP, or for the copy the GB, of one call."""
    random = torch.Generator().manual_seed(0)
    a, b = torch.rand(2, _SIDE, _SIDE, generator=random)
    product = torch.empty_like(a)
    left, right = a.numpy(), b.numpy()
    gflop = 2 * _SIDE**3 / 1e9
    for threads in thread_counts:
        at = _at(threads)
        yield Repeated(f"sgemm by torch, {at}", lambda: torch.mm(a, b, out=product), threads=threads), gflop
        for channels, kernel, side in _CONVOLUTIONS:
            convolution = _Convolution(channels, kernel, side)
            name = f"convolution {kernel}x{kernel}, {channels} channels of {side}x{side}, {at}"
            yield Repeated(name, convolution, threads=threads), convolution.gflop
        buffer = torch.zeros(_COPY_MB * 1_000_000 // 4)
        target = torch.zeros_like(buffer)
        copy = Repeated(f"memory copy, {at}", _Copy(target, buffer), threads=threads, samples=3)
        yield copy, 2 * _COPY_MB / 1e3
    # NumPy's own threads cannot be set from here: CPU time tells what one does.
    yield Repeated("sgemm by numpy, its own threads", lambda: np.matmul(left, right)), gflop


def _at(threads: int) -> str:
    return "1 thread" if threads == 1 else f"{threads} threads"


class _Copy:
    def __init__(self, target: torch.Tensor, source: torch.Tensor) -> None:
        self._target, self._source = target, source

    def __call__(self) -> object:
        return self._target.copy_(self._source)


class _Convolution:
    """Channels-last, as the network's."""

    def __init__(self, channels: int, kernel: int, side: int) -> None:
        self._x = torch.rand(1, channels, side, side).to(memory_format=torch.channels_last)
        self._w = torch.rand(channels, channels, kernel, kernel).to(memory_format=torch.channels_last)
        self._padding = kernel // 2
        self.gflop = 2 * channels**2 * kernel**2 * side**2 / 1e9

    @torch.inference_mode()
    def __call__(self) -> object:
        return functional.conv2d(self._x, self._w, padding=self._padding)


def rates(figures: Sequence[Figure], work: Mapping[str, float]) -> dict[str, float]:
    """GFLOP or GB a second of each figure at its best: of CPU time with one thread, of the wall's with more."""
    return {
        figure.name: 1e3 * work[figure.name] / (figure.cpu_least_ms if figure.threads == 1 else figure.wall_least_ms)
        for figure in figures
    }


def peak_gflops(found: Mapping[str, float], threads: int = 1) -> float:
    """The largest measured at so many threads: what everything else is a share of."""
    ends = (_at(threads), "its own threads") if threads == 1 else (_at(threads),)
    return max(rate for name, rate in found.items() if name.endswith(ends) and not name.startswith("memory"))


def bandwidth_gbps(found: Mapping[str, float], threads: int = 1) -> float:
    """Read and written by a copy, GB/s."""
    return found[f"memory copy, {_at(threads)}"]


def describe() -> dict[str, object]:
    """This machine and what runs on it, without its name."""
    return {
        "cpu": f"{os.cpu_count()} vCPU {_cpu_name()}",
        "python": platform.python_version(),
        **{name: found for name in _PACKAGES if (found := _version(name)) is not None},
    }


def _cpu_name() -> str:
    """As the kernel says, where it says it; a family that tells more beside it."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor() or platform.machine()
    said = dict(re.findall(r"^([\w ]+?)\s*: (.*)$", text, re.MULTILINE))
    name = said.get("model name", platform.machine())
    zen = {"23": "Zen 1 or 2", "25": "Zen 3 or 4", "26": "Zen 5"}.get(said.get("cpu family", ""))
    return f"{name} ({zen})" if zen is not None and "AMD" in name else name


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
